"""Round trip, frames per second and memory of members in Python, JavaScript, Java and C.

    python -m benchmarks.members [--ticks N] [--frames N] [--json]

Each member is the generator of the conformance suite. `start` is the time from the start of its
process to its token; `round trip` the median and the 95th percentile of a tick, from the request to
the answer, with 20 ticks before the measurement; `frames` are those of a world with this generator
and a Python host of one agent; `memory` is the resident set and the proportional set, which divides
shared pages among the processes that use them. Members without their tools are left out.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.command import Table, options
from minerva_bus.frame import messages as m
from minerva_bus.wire.codec import encode, stamp, stamped
from minerva_bus.wire.plain import unpack
from minerva_conformance.launching import RunningMember, command
from minerva_conformance.scripted_world import ScriptedHub, ScriptedWorld
from minerva_conformance.world import DT, MEMBER, SEED, VOCABULARY

MEMBERS = Path(__file__).parents[1] / "members"
TURNS = 5
WARM = 20
EPOCH = 1
SECONDS = 30.0
WORLD = """[world]
string = "ACounter#a"
vocabulary = "minerva_conformance.world:VOCABULARY"
frames = {frames}

[process.counters]
agents = "minerva_conformance.world:Counter"

[process.member]
command = {command}
"""


@dataclass(frozen=True)
class Language:
    """How the member in a language is built and started; `needs` are programs."""

    name: str
    words: tuple[str, ...]
    needs: tuple[str, ...] = ()
    folder: str = ""


def languages(build: Path) -> list[Language]:
    """The members; compiled ones are below `build`."""
    script = str(MEMBERS / "javascript" / "examples" / "conformance.js")
    java = ("java", "-cp", str(build / "java"), "Conformance")
    return [
        Language("Python", (sys.executable, "-m", "minerva_conformance")),
        Language("JavaScript", ("node", script), ("node",)),
        Language("Java", java, ("make", "java", "javac"), "java"),
        Language("C", (str(build / "c" / "conformance"),), ("make", "cc"), "c"),
    ]


def build_members(build: Path, chosen: Sequence[Language]) -> None:
    """Run make for the members that need it."""
    for language in chosen:
        if language.folder:
            words = ["make", "-s", "-C", str(MEMBERS / language.folder)]
            subprocess.run([*words, f"BUILD={build / language.folder}"], check=True)


class Played:
    """A member in a world without a coordinator, whose part this plays."""

    def __init__(self, hub: ScriptedHub, world: str, words: Sequence[str]) -> None:
        self.stage = ScriptedWorld(hub, world, MEMBER)
        self.environment = {
            "MINERVA_WORLD": world,
            "MINERVA_CONNECT": hub.endpoint,
            "MINERVA_NAME": MEMBER,
        }
        self.words = words

    def __enter__(self) -> Played:
        self.stage.__enter__()
        self.stage.appear(EPOCH)
        began = time.perf_counter()
        self.process: RunningMember = command(self.words)(self.environment)
        self.receive(self.stage.keys.alive(MEMBER))
        self.start = time.perf_counter() - began
        self.send("to/" + MEMBER, m.Greet())
        self.receive(self.stage.keys.sent_by(MEMBER))
        world = self.stage.keys.world
        self.send("to/" + MEMBER, m.Welcome(world, VOCABULARY, SEED, DT, 0, "sequential"))
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.stage.__exit__()

    def send(self, key: str, message: m.ToMember) -> None:
        """Send a message to the member."""
        self.stage.put(key, stamp(EPOCH) + encode(message))

    def receive(self, key: str) -> bytes:
        """The next message on a key."""
        until = self.stage.now() + SECONDS
        while (sample := self.stage.next(until)) is not None:
            if sample.key == key:
                return sample.data
        raise SystemExit(f"{self.words[0]} does not answer on {key}\n{self.process.output()}")

    def tick(self, frame: int) -> float:
        """Seconds from the request of a frame to its answer."""
        began = time.perf_counter()
        self.send("tick", m.TickRequest(frame))
        while unpack(stamped(self.receive(self.stage.keys.sent_by(MEMBER)))[1])[0] != "ticked":
            pass  # Metrics.
        return time.perf_counter() - began

    def memory(self) -> Mapping[str, float]:
        """Resident and proportional set of the member, in MB."""
        (pid,) = children_of(os.getpid())
        text = Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="ascii")
        sizes = dict(re.findall(r"^(Rss|Pss): +(\d+) kB", text, re.M))
        return {"rss_mb": int(sizes["Rss"]) / 1000, "pss_mb": int(sizes["Pss"]) / 1000}


def children_of(pid: int) -> list[int]:
    """The processes that a process has started."""
    tasks = Path(f"/proc/{pid}/task").glob("*/children")
    return [int(child) for task in tasks for child in task.read_text(encoding="ascii").split()]


def frames_per_second(words: Sequence[str], frames: int) -> float:
    """Frames per second of a world with this generator."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "world.toml"
        file.write_text(WORLD.format(frames=frames, command=json.dumps(list(words))))
        run = [sys.executable, "-m", "minerva_bus.cli.main", "run", str(file), "--json"]
        done = subprocess.run(run, capture_output=True, text=True, cwd=folder, check=True)
        return float(json.loads(done.stdout)["frames_per_second"])


def measured(hub: ScriptedHub, language: Language, turn: int, ticks: int, frames: int) -> dict:
    """The figures of one turn."""
    with Played(hub, f"members-{language.name.lower()}-{turn}", language.words) as played:
        seconds = [played.tick(frame) for frame in range(WARM + ticks)][WARM:]
        quantiles = statistics.quantiles(seconds, n=20)
        figures = {
            "start_s": played.start,
            "median_us": 1e6 * statistics.median(seconds),
            "p95_us": 1e6 * quantiles[-1],
            **played.memory(),
        }
    return {**figures, "frames_per_s": frames_per_second(language.words, frames)}


def main(words: Sequence[str] | None = None) -> None:
    """Print a row for each language: the median of the turns, which alternate."""
    given = options(__doc__, words, ticks=2000, frames=2000)
    table = Table(
        {"member": "<10", "start s": ">8.2f", "µs": ">7.0f", "95 %": ">7.0f", "frames/s": ">9.0f",
         "RSS MB": ">7.1f", "PSS MB": ">7.1f"},
        as_json=given.json,
    )  # fmt: skip
    with tempfile.TemporaryDirectory() as folder, ScriptedHub() as hub:
        known = languages(Path(folder))
        chosen = [each for each in known if all(shutil.which(need) for need in each.needs)]
        build_members(Path(folder), chosen)
        turns = [
            {each.name: measured(hub, each, turn, given.ticks, given.frames) for each in chosen}
            for turn in range(TURNS)
        ]
    for name in turns[0]:
        medians = {key: statistics.median(t[name][key] for t in turns) for key in turns[0][name]}
        order = ("start_s", "median_us", "p95_us", "frames_per_s", "rss_mb", "pss_mb")
        table.row({"member": name, **medians}, name, *(medians[key] for key in order))


if __name__ == "__main__":
    main()
