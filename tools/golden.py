"""Golden values of the shipped worlds: digests of the last string and of all messages.

    python -m tools.golden            # compare with tests/golden/worlds.toml; 1 if they differ
    python -m tools.golden --record   # write it

A change that should not affect worlds or messages leaves the values unchanged. Any other change
records new values, with the reason in CHANGELOG.md; a change of the wire format also gets a new
version in PROTOCOL.md.
"""

from __future__ import annotations

import argparse
import json
import sys
import tomllib
from collections.abc import Mapping
from dataclasses import replace
from hashlib import blake2b
from pathlib import Path
from typing import Any

from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.member_side import Member
from minerva_bus.launch.installed import find_world
from minerva_bus.launch.world_files import read_world_file
from minerva_bus.runtime.runner import InProcessRunner
from minerva_bus.settings.world_settings import Overrides
from minerva_bus.wire.codec import encode

ROOT = Path(__file__).resolve().parents[1]
GOLDEN = ROOT / "tests" / "golden" / "worlds.toml"
WORLDS: Mapping[str, tuple[str, dict[str, Any]]] = {
    "crowd": ("worlds/minerva_worlds/crowd/crowd.toml", {"frames": 12}),
    "flock": ("worlds/minerva_worlds/flock/flock.toml", {"frames": 12, "options": {"birds": "80"}}),
    "meadow": ("worlds/minerva_worlds/meadow/meadow.toml", {"frames": 60}),
    "plants": ("worlds/minerva_worlds/plants/plants.toml", {"frames": 40}),
    "robot": ("robot", {"frames": 25}),
    "robots": ("worlds/minerva_worlds/robots/robots.toml", {"frames": 12}),
    "slime": (
        "worlds/minerva_worlds/slime/slime.toml",
        {"frames": 12, "options": {"cells": "400", "width": "60", "height": "40"}},
    ),
    "traffic": ("worlds/minerva_worlds/traffic/traffic.toml", {"frames": 40}),
    "village": ("worlds/minerva_worlds/village/village.toml", {"frames": 40}),
    "warehouse": ("worlds/minerva_worlds/warehouse/warehouse.toml", {"frames": 40}),
}
HEAD = """\
# Golden values of the shipped worlds in one process, written by `python -m tools.golden --record`:
# the digest of the string after so many frames, and by type a digest of all messages of the run.
"""


class MessageDigests:
    """Digests of the messages of a run, by message type."""

    def __init__(self) -> None:
        self._hashes: dict[str, Any] = {}

    def add(self, message: Any) -> None:
        if isinstance(message, m.Hello):  # Process id and machine are not properties of the run.
            message = replace(message, about={"service": message.service})
        if isinstance(message, m.Report):  # Figures can depend on time, such as calls under way.
            message = replace(message, figures={})
        name = type(message).__name__
        data = encode(message)
        known = self._hashes.setdefault(name, blake2b(digest_size=16))
        known.update(len(data).to_bytes(8, "little") + data)

    def digests(self) -> dict[str, str]:
        return {name: self._hashes[name].hexdigest() for name in sorted(self._hashes)}


class Tapped:
    """A member whose messages, in both directions, are also passed to a MessageDigests."""

    def __init__(self, member: Member, wire: MessageDigests) -> None:
        self._member, self._wire = member, wire

    def __getattr__(self, name: str) -> Any:
        return getattr(self._member, name)

    def receive(self, message: m.ToMember | m.Readings) -> list[Any]:
        self._wire.add(message)
        answers = self._member.receive(message)
        for answer in answers:
            self._wire.add(answer)
        return answers


def golden_values(name: str) -> dict[str, str]:
    """Run a world; return the digests of its string, as `string`, and of its messages by type."""
    path, overrides = WORLDS[name]
    file = read_world_file(
        ROOT / path if path.endswith(".toml") else find_world(path), Overrides(**overrides)
    )
    algorithm, wire, digests = FrameAlgorithm(file.world), MessageDigests(), [""]

    def watch(instruction: s.Instruction) -> None:
        if isinstance(instruction, s.FrameDone):
            wire.add(instruction.record)
            digests.append(instruction.record.digest.hex())

    members: Any = [Tapped(process.make_member(), wire) for process in file.processes]
    runner = InProcessRunner(algorithm, members, watch)
    runner.start()
    while runner.ended is None:
        runner.handle(s.Begin())
    return {"string": digests[-1], **wire.digests()}


def recorded_values() -> dict[str, dict[str, str]]:
    """Recorded values by world."""
    return tomllib.loads(GOLDEN.read_text(encoding="utf-8"))


def _text(values: Mapping[str, Mapping[str, str]]) -> str:
    tables = [
        "\n".join([f"[{name}]", *[f'{key} = "{value}"' for key, value in table.items()]])
        for name, table in values.items()
    ]
    return HEAD + "\n" + "\n\n".join(tables) + "\n"


def main() -> int:
    parser = argparse.ArgumentParser(description="golden values of the shipped worlds")
    parser.add_argument("--record", action="store_true", help="write tests/golden/worlds.toml")
    parser.add_argument("--json", action="store_true", help="print the values instead")
    arguments = parser.parse_args()
    values = {name: golden_values(name) for name in WORLDS}
    if arguments.json:
        print(json.dumps(values))
        return 0
    if arguments.record:
        GOLDEN.write_text(_text(values), encoding="utf-8")
        return 0
    known = recorded_values()
    differing = [
        f"{name}: {key}"
        for name, table in values.items()
        for key in sorted(table.keys() | known.get(name, {}).keys())
        if table.get(key) != known.get(name, {}).get(key)
    ]
    print("\n".join(differing) or "all values are as recorded")
    return 1 if differing else 0


if __name__ == "__main__":
    sys.exit(main())
