"""Frames, memory and start of worlds with one coordinator, from small ones to its limits.

    python -m benchmarks.limits [--members 10 100 500 1000] [--shared 10 100 500 1000]
        [--agents 100000 1000000 2000000] [--sending 100000 1000000 2000000]
        [--in-process 100000 1000000 10000000] [--seconds 10] [--json]

`members` do nothing, in step: each frame asks each of them and waits for its answer. They have
processes of their own, and `shared` ones a process together. `agents` are in columns on a host;
each has one number, which changes in each frame. `sending` ones also send an event to the next
one, which counts it. `in process` is `agents` without a bus. A size of 0 leaves a part out.

`start` is from the command to the end of the first frame. What follows is from --seconds after it:
frames per second, CPU time of all processes per frame, and the bytes of its messages at the
coordinator (median). `MB` is the memory of all processes at the end, with shared memory counted
once, and for `in process` the peak. `numpy` is the time of the same change of one array.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.command import Table, options
from minerva_bus import (
    Agent,
    BatchContext,
    Event,
    EventBatch,
    EventType,
    Generator,
    Primitive,
    Scene,
    Tick,
    Vocabulary,
    on,
)
from minerva_bus.errors import MinervaError
from minerva_bus.grammar.ids import Ids
from minerva_bus.runtime.operator_client import Client

ROOT: Final = Path(__file__).parents[1]
CLOCK_TICKS: Final = os.sysconf("SC_CLK_TCK")
START_SECONDS: Final = 600.0
END_SECONDS: Final = 120.0
CASES: Final = ("members", "shared", "agents", "sending", "in process")
COLUMNS: Final = {
    "case": "<10", "size": ">10,", "start s": ">8.1f", "frames/s": ">9.2f", "CPU ms": ">9.1f",
    "kB/frame": ">10,.1f", "MB": ">8,.0f", "bytes each": ">11,.0f", "numpy ms": ">9.2f",
}  # fmt: skip

WORLD: Final = """
[world]
scene = "benchmarks.limits:drops"
vocabulary = "benchmarks.limits:vocabulary"

[options]
agents = {agents}
sends = {sends}
"""
MEMBERS: Final = """
[process.idle]
service = "benchmarks.limits:Idle"
processes = {size}
"""
SHARED: Final = """
[process.host]
agents = "benchmarks.limits:Drop"
processes = "auto"
"""
AGENTS: Final = """
[process.clock]
service = "benchmarks.limits:Clock"

[process.host]
agents = ["benchmarks.limits:Drop", "benchmarks.limits:Sender"]
"""

eStep, ePass = EventType("eStep"), EventType("ePass")


class Drop(Agent, symbol="ADrop"):
    """An agent with one number, which changes in each frame."""

    x: float = 0.0

    @on("eStep", population=True)
    def fall(self, step: Event, moment: BatchContext) -> None:
        self.x += 1.0


class Sender(Drop, symbol="ASender"):
    """A drop that also sends an event to the next one."""

    @on("eStep", population=True)
    def send(self, step: Event, moment: BatchContext) -> None:
        self.x += 1.0
        moment.emit(ePass(receivers=following(len(self))))

    @on("ePass", together=True)
    def count(self, passed: EventBatch, moment: BatchContext) -> None:
        self.x += np.bincount(passed.row, minlength=len(self))


@cache
def following(count: int) -> Ids:
    """The receivers of the events of agents that stand in a circle."""
    return Ids.numbered("d", np.roll(np.arange(count), -1))


class Clock(Generator, events=("eStep",)):
    """Lets all agents act in each frame."""

    def generate(self, tick: Tick) -> Event:
        return eStep()


class Idle(Generator):
    by_agent = True  # It has no events, and may have many processes.


PStone = Primitive("PStone")
vocabulary = Vocabulary.of(PStone, eStep, ePass, Drop, Sender)


def drops(given: Mapping[str, Any]) -> Scene:
    """The initial string: agents in columns; without any a stone, as an empty world is over."""
    agents, kind = given["agents"], Sender if given["sends"] else Drop
    return kind.many("d", agents, x=np.sqrt(np.arange(agents))) if agents else PStone()


@dataclass(frozen=True, slots=True)
class Row:
    """One line of the table."""

    case: str
    size: int
    start_s: float
    frames_per_s: float
    cpu_ms: float
    kb_per_frame: float
    memory_mb: float
    numpy_ms: float | None = None

    def cells(self) -> tuple[Any, ...]:
        """What the table shows of it."""
        *first, numpy_ms = asdict(self).values()
        return *first, 1e6 * self.memory_mb / self.size, numpy_ms


@dataclass(frozen=True, slots=True)
class Sample:
    """The number of frames of a world, and the CPU time of its processes, at a time."""

    at: float
    frame: int
    cpu: float


class Running:
    """A world on the bus in a folder, with all its processes."""

    def __init__(self, folder: Path, text: str) -> None:
        self._folder = folder
        environment = {**os.environ, "MINERVA_RUNTIME_DIR": str(folder)}
        self.launcher = subprocess.Popen(
            command(folder, text, "--profile"),
            cwd=ROOT, env=environment, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip

    def sample(self) -> Sample:
        """How far the world is, as soon as it answers after its first frame."""
        until = time.monotonic() + START_SECONDS
        while time.monotonic() < until and self.launcher.poll() is None:
            try:
                with self._client() as client:
                    frame = client.operator.status().frame
            except (MinervaError, OSError, ValueError):
                frame = 0
            if frame:
                cpu = sum(map(cpu_seconds, self._processes()))
                return Sample(time.monotonic(), frame, cpu)
            time.sleep(0.2)
        sys.exit(f"the world has ended, or had no frame within {START_SECONDS:.0f} s")

    def memory(self) -> float:
        """Memory in MB, with shared memory counted once."""
        return sum(map(proportional, self._processes()))

    def end(self) -> dict[str, Any]:
        """Stop the world; returns its summary."""
        with self._client() as client:
            client.ask("stop")
        return json.loads(self.launcher.communicate(timeout=END_SECONDS)[0])

    def _client(self) -> Client:
        (path,) = self._folder.glob("*.json")
        state = json.loads(path.read_text(encoding="utf-8"))
        return Client(state["endpoint"], state["world"])

    def _processes(self) -> list[int]:
        """The launcher, the coordinator and the members."""
        pid = self.launcher.pid
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text(encoding="ascii")
        return [pid, *map(int, children.split())]


def command(folder: Path, text: str, *more: str) -> list[str]:
    """The command that runs the world of a file, which is written to a folder."""
    file = folder / "limits.toml"
    file.write_text(text, encoding="utf-8")
    minerva = [sys.executable, "-m", "minerva_bus.cli.main", "run", str(file)]
    return [*minerva, "--rate", "0", "--quiet", "--json", *more]


def cpu_seconds(pid: int) -> float:
    """CPU time of a process."""
    text = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8")
    user, system = text.rpartition(")")[2].split()[11:13]
    return (int(user) + int(system)) / CLOCK_TICKS


def proportional(pid: int) -> float:
    """Memory of a process in MB; memory that it shares is divided by those that do."""
    lines = Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("Pss:")) / 1000


def on_bus(case: str, size: int, seconds: float, folder: Path) -> Row:
    """Run a world with processes for some seconds after its first frame."""
    members, sends = case in ("members", "shared"), "true" if case == "sending" else "false"
    text = WORLD.format(agents=0 if members else size, sends=sends)
    text += MEMBERS.format(size=size) if members else AGENTS
    # Services share a process in a world that leaves the number of processes to the launcher.
    running = Running(folder, text + SHARED if case == "shared" else text)
    try:
        first = running.sample()
        time.sleep(seconds)
        last = running.sample()
        memory = running.memory()
        summary = running.end()
    finally:
        running.launcher.kill()
    frames = last.frame - first.frame
    rate, cpu = frames / (last.at - first.at), 1e3 * (last.cpu - first.cpu) / frames
    sent = sum(summary["profile"][way]["p50"] for way in ("bytes in", "bytes out"))
    start = summary["first_frame_seconds"]
    return Row(case, size, start, rate, cpu, 1e-3 * sent, memory)


def in_process(size: int, folder: Path) -> Row:
    """Run agents without a bus."""
    frames = min(1000, max(20, round(2e8 / size)))
    words = command(folder, WORLD.format(agents=size, sends="false") + AGENTS, "--in-process")
    process = subprocess.Popen(
        [*words, "--frames", str(frames)], cwd=ROOT, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    summary = json.loads(process.stdout.read())
    _, _, used = os.wait4(process.pid, 0)
    start, rate = summary["first_frame_seconds"], summary["frames_per_second"]
    array, began = np.zeros(size), time.perf_counter()
    for _ in range(frames):
        array += 1.0
    alone = 1e3 * (time.perf_counter() - began) / frames
    return Row("in process", size, start, rate, 1e3 / rate, 0.0, used.ru_maxrss / 1e3, alone)


def main() -> None:
    """Print a row for each size."""
    given = options(
        __doc__,
        members=[10, 100, 500, 1000],
        shared=[10, 100, 500, 1000],
        agents=[100_000, 1_000_000, 2_000_000],
        sending=[100_000, 1_000_000, 2_000_000],
        in_process=[100_000, 1_000_000, 10_000_000],
        seconds=10.0,
    )
    table = Table(COLUMNS, as_json=given.json)
    for case in CASES:
        for size in filter(None, getattr(given, case.replace(" ", "_"))):
            with tempfile.TemporaryDirectory() as name:
                row = (
                    in_process(size, Path(name))
                    if case == "in process"
                    else on_bus(case, size, given.seconds, Path(name))
                )
            table.row(asdict(row), *row.cells())


if __name__ == "__main__":
    main()
