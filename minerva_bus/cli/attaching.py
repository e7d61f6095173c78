"""`minerva attach`."""

from __future__ import annotations

import signal
import sys
from pathlib import Path
from types import FrameType
from typing import Any

from minerva_bus.bus.member import BusMember
from minerva_bus.cli.places import place
from minerva_bus.errors import WorldFileError
from minerva_bus.frame.participant import Participant
from minerva_bus.launch.specs import AGENTS, bind, entries, find_agents, find_service, load
from minerva_bus.launch.worldfile import toml_value
from minerva_bus.world.agent import Agent


def attach_member(spec: str, connect: str, world: str, name: str, options: dict[str, str]) -> int:
    """Take part in a running world until it ends or Ctrl-C; the exit code."""
    endpoint, world = place(connect, world)
    participant = _participant(spec, name, options)

    def tell(line: str) -> None:
        print(line, file=sys.stderr, flush=True)  # noqa: T201

    member = BusMember(participant, world, endpoint, tell)
    leave_on_signals(member)
    tell(f"{participant.name}: joining {world} at {endpoint}; Ctrl-C leaves")
    code = member.run()
    if participant.stopped:
        tell(f"{participant.name}: the world has ended: {participant.stopped}")
    return code


def bridge_source(
    kind: str, source: str, connect: str, world: str, name: str, options: dict[str, str]
) -> int:
    """Bring what a source says into a running world until it ends or Ctrl-C; the exit code."""
    option = getattr(find_service(kind, Path.cwd()), "source_option", "")
    if source and not option:
        raise WorldFileError(f"{kind} is no bridge that a source can be named for; see its options")
    if source:
        path = Path(source)  # Not resolved: a device's link may lead elsewhere when it is back.
        options = {**options, option: str(path.absolute()) if path.exists() else source}
    return attach_member(kind, connect, world, name, options)


def leave_on_signals(member: BusMember) -> None:
    """Let Ctrl-C and SIGTERM mean that the member leaves its world; a second one ends it."""

    def leave(number: int, frame: FrameType | None) -> None:
        signal.signal(number, signal.SIG_DFL)
        member.leave()

    signal.signal(signal.SIGINT, leave)
    signal.signal(signal.SIGTERM, leave)


def _participant(spec: str, name: str, options: dict[str, str]) -> Participant:
    import os

    folder = Path.cwd()
    short = spec.rpartition(":")[2].rpartition(".")[2].lower()
    name = name or f"{short}-{os.getpid()}"
    if _names_agents(spec, folder):
        if options:
            raise WorldFileError(f"{spec} names agents, which have no options")
        return Participant(name, None, find_agents(spec, folder))
    typed: dict[str, Any] = {key: toml_value(value) for key, value in options.items()}
    return Participant(name, bind(find_service(spec, folder), typed, name)())


def _names_agents(spec: str, folder: Path) -> bool:
    if ":" not in spec:
        return spec in entries(AGENTS)
    found = load(spec, folder)
    return isinstance(found, type) and issubclass(found, Agent)
