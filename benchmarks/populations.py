"""Agent updates per second of complete models, compared with other platforms in one run.

    python -m benchmarks.populations [--model flock wealth ...] [--agents N ...] [--hosts 1 2]
        [--in-process] [--systems minerva mesa mesa-frames] [--json]

Each model (benchmarks/models) runs over the real bus: a coordinator, its services and one or two
hosts in separate processes. The peers' scripts are in --peers (`bench_mesa.py` with a virtual
environment `venvs/mesa`, and so on); missing ones are skipped with a message. Absolute rates depend
on the load of the machine; compare the ratios, which are from alternating turns in one run. Memory
is the sum of the processes' peaks and counts shared memory (libraries) once; a peer has a single
process.

The comparison is between equal models, not equal work: Minerva Bus checks a grammar, keeps the
string of every frame, can compute its digest (--digest does so in each frame), and gives the same
string in any layout. Mesa activates agents one after another; mesa-frames and Minerva Bus activate
them simultaneously. Mesa's rate for `plain` is for agents without actions, called in any order.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Final

from benchmarks.command import PEERS_FOLDER, Option, Table, options
from benchmarks.forked import Members, answered, coordinator
from benchmarks.models import MODELS, Model, counted, cycle, load
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.member_side import Member
from minerva_bus.frame.world_state import WorldSpec
from minerva_bus.grammar.columns import size
from minerva_bus.runtime.runner import InProcessRunner
from minerva_bus.world.event_collection import Priority

WARM_UP: Final = 3
SYSTEMS: Final = ("minerva", "mesa", "mesa-frames")
COLUMNS: Final = {
    "system": "<19", "model": "<11", "agents": ">9,", "hosts": ">5", "updates/s": ">12,.0f",
    "frames/s": ">9.1f", "MB": ">7.0f", "ratio": ">7.2f",
}  # fmt: skip
SIZES: Final[dict[str, tuple[int, ...]]] = {
    "flock": (1_000, 10_000),
    "schelling": (31_830,),
    "wolf_sheep": (15_000,),
    "wealth": (100_000, 1_000_000),
    "plain": (10_000,),
}
MESA: Final = {
    "flock": ("boids", 100),
    "schelling": ("schelling", 318),
    "wolf_sheep": ("wolfsheep", 150),
    "wealth": ("wealth", 100),
    "plain": ("noop", 100),
}
"""Mesa's name of each model, and its number of agents at scale 1."""

Figures = dict[str, float]


@dataclass(frozen=True, slots=True)
class Row:
    """One line of the table."""

    system: str
    model: str
    agents: int
    hosts: int
    updates_per_s: float
    frames_per_s: float
    memory_mb: float
    ratio: float = 0.0


# --- Minerva Bus ---


@dataclass(frozen=True, slots=True)
class Task:
    """A run of a model; without hosts it runs in this process."""

    model: str
    agents: int
    hosts: int
    frames: int
    seed: int = 1
    digest: int = 0

    def words(self) -> list[str]:
        """The task as command line arguments."""
        return [
            self.model,
            *map(str, (self.agents, self.hosts, self.frames, self.seed, self.digest)),
        ]

    @staticmethod
    def of(words: Sequence[str]) -> Task:
        """The task from its command line arguments."""
        return Task(words[0], *map(int, words[1:]))


def world_of(task: Task, members: Sequence[str]) -> WorldSpec:
    """The world of a model."""
    model = load(task.model)
    return WorldSpec(
        "populations",
        model.scene(task.agents, task.seed),
        model.vocabulary,
        seed=task.seed,
        order=Priority(model.order),
        frames=task.frames,
        expected=frozenset(members),
    )


class Meter:
    """Measures the time of each step of a model, and counts its agent updates."""

    def __init__(self, model: Model, task: Task) -> None:
        self._model = model
        self._agents = task.agents
        self._digest = task.digest
        self._cycle = cycle(model)
        self._last = 0.0
        self._acting = 0.0
        self._frames = 0
        self.steps: list[tuple[float, float]] = []
        """Seconds and updates of each step after the warm-up."""

    def frame_done(self, algorithm: FrameAlgorithm) -> None:
        """Record the end of a frame."""
        self._frames += 1
        if self._digest:
            assert algorithm.scene.digest
        if self._frames % self._cycle:
            return
        now = time.perf_counter()
        if self._frames > WARM_UP * self._cycle:
            self.steps.append((now - self._last, self._acting))
        self._last, self._acting = now, self._updates(algorithm)

    def _updates(self, algorithm: FrameAlgorithm) -> float:
        kinds = counted(self._model)
        if not kinds:
            return self._model.updates_per_frame(self._agents) * self._cycle
        fragments = algorithm.composition.fragments.values()
        return sum(size([fragment]) for fragment in fragments if fragment.symbol in kinds)

    def figures(self) -> Figures:
        """Medians of the rates."""
        rates = [updates / seconds for seconds, updates in self.steps]
        middle = statistics.median(seconds for seconds, _ in self.steps)
        return {
            "updates_per_s": statistics.median(rates),
            "frames_per_s": self._cycle / middle,
        }


def in_process(task: Task) -> Figures:
    """Run a model in this process."""
    model = load(task.model)
    services = model.services(task.agents)
    algorithm = FrameAlgorithm(world_of(task, ["host-0", *services]))
    meter = Meter(model, task)
    participants = [Member(name, make()) for name, make in services.items()]

    def watch(instruction: s.Instruction) -> None:
        if isinstance(instruction, s.FrameDone):
            meter.frame_done(algorithm)

    runner = InProcessRunner(
        algorithm, [*participants, Member("host-0", agents=model.kinds)], watch
    )
    runner.start()
    while runner.ended is None:
        runner.handle(s.Begin())
    return {**meter.figures(), "memory_mb": memory("self")}


def on_bus(task: Task) -> Figures:
    """Run a model over the bus: coordinator in this process, hosts and services in others."""
    model = load(task.model)
    names = [*(f"host-{number}" for number in range(task.hosts)), *model.services(task.agents)]
    members = Members("populations", {name: partial(member, name, task) for name in names})
    peaks: list[float] = []
    meter = Meter(model, task)

    def done(_: s.FrameDone) -> None:
        meter.frame_done(hub.algorithm)
        if hub.algorithm.frame == task.frames:
            peaks.extend(map(memory, ["self", *members.pids.values()]))

    def look(_: object) -> None:
        gone = members.failed()
        if gone and not hub.algorithm.shutdown.failed:
            hub.algorithm.shutdown.failed = True
            hub.handle(s.End(f"{gone[0]} has failed"))

    hub = coordinator(world_of(task, names), members.connect, done, look)
    hub.run()
    members.wait()
    if not peaks:
        sys.exit(f"{task.model} did not come to its end")
    return {**meter.figures(), "memory_mb": sum(peaks)}


def member(name: str, task: Task) -> Member:
    """A host or a service."""
    model = load(task.model)
    make = model.services(task.agents).get(name)
    return Member(name, make()) if make is not None else Member(name, None, model.kinds)


def memory(process: int | str) -> float:
    """Peak memory of a process in MB; shared memory counts proportionally."""
    sizes: dict[str, int] = {}
    for file in ("status", "smaps_rollup"):
        for line in Path(f"/proc/{process}/{file}").read_text().splitlines():
            words = line.split()
            if words[-1:] == ["kB"]:
                sizes[words[0]] = int(words[1])
    return (sizes["VmHWM:"] - (sizes["Rss:"] - sizes["Pss:"])) / 1024


def minerva(task: Task) -> Figures | str:
    """Run a model in a separate process, so that its peak memory is its own."""
    words = [sys.executable, "-m", __spec__.name, "--task", *task.words()]
    return answered(words)


# --- peers ---


def mesa(model: str, agents: int, folder: Path, seconds: float) -> Figures | str:
    """Run Mesa's model of the same name."""
    if model not in MESA:
        return "it has no such model"
    name, unit = MESA[model]
    options = ["--model", name, "--scale", str(max(1, round(agents / unit)))]
    return peer("mesa", "bench_mesa.py", options, folder, seconds)


def mesa_frames(model: str, agents: int, folder: Path, seconds: float, style: str) -> Figures | str:
    """Run the model of mesa-frames."""
    if model != "wealth":
        return "it has no such model"
    options = ["--scale", str(max(1, agents // 100)), "--style", style]
    return peer("mesaframes", "bench_mesaframes.py", options, folder, seconds)


def peer(name: str, script: str, options: list[str], folder: Path, seconds: float) -> Figures | str:
    """Run a peer's script; returns its results, or the reason why there are none."""
    python = (folder / "venvs" / name / "bin" / "python").absolute()
    for needed in (folder / script, python):
        if not needed.is_file():
            return f"{needed} is not there"
    words = [str(python), script, *options, "--seconds", str(seconds)]
    answer = answered(words, folder)
    return (
        answer
        if isinstance(answer, str)
        else {
            "agents": answer["agents"],
            "updates_per_s": answer["agent_updates_per_s"],
            "frames_per_s": 1e6 / answer["us_per_step_median"],
            "memory_mb": answer["max_rss_mb"],
        }
    )


# --- the table ---


def runs_of(arguments: argparse.Namespace, model: str, agents: int):
    """All runs for one model and size: system, number of hosts, and function."""
    if "minerva" in arguments.systems:
        for hosts in [0] if arguments.in_process else arguments.hosts:
            frames = (WARM_UP + arguments.frames) * cycle(load(model))
            task = Task(model, agents, hosts, frames, digest=int(arguments.digest))
            yield "minerva", hosts, lambda task=task: minerva(task)
    folder, seconds = arguments.peers, arguments.seconds
    if "mesa" in arguments.systems:
        yield "mesa", 0, lambda: mesa(model, agents, folder, seconds)
    if "mesa-frames" in arguments.systems:
        for style in ("native", "api"):
            yield (
                f"mesa-frames {style}",
                0,
                lambda style=style: mesa_frames(model, agents, folder, seconds, style),
            )


def measured(arguments: argparse.Namespace, model: str, agents: int) -> list[Row]:
    """All systems at one size, in turns; ratios are the fastest Minerva Bus row to each."""
    turns: dict[tuple[str, int], list[Figures]] = {}
    missing: set[tuple[str, int]] = set()
    for _ in range(arguments.turns):
        for system, hosts, run in runs_of(arguments, model, agents):
            if (system, hosts) in missing:
                continue
            result = run()
            if isinstance(result, str):
                missing.add((system, hosts))
                print(f"{system}: {model} left out: {result}", file=sys.stderr)
            else:
                turns.setdefault((system, hosts), []).append(result)
    rows = [_row(system, model, agents, hosts, all) for (system, hosts), all in turns.items()]
    ours = max((row.updates_per_s for row in rows if row.system == "minerva"), default=0.0)
    return [_with_ratio(row, ours) for row in rows]


def _row(system: str, model: str, agents: int, hosts: int, turns: list[Figures]) -> Row:
    middle = {key: statistics.median(turn[key] for turn in turns) for key in turns[0]}
    agents = int(middle.pop("agents", agents))
    return Row(system, model, agents, hosts, **middle)


def _with_ratio(row: Row, ours: float) -> Row:
    return Row(**{**asdict(row), "ratio": ours / row.updates_per_s})


def main() -> None:
    """Measure in turns and print a table."""
    arguments = options(
        __doc__,
        model=Option(list(MODELS), choices=MODELS),
        agents=Option([0], "instead of the sizes of each model"),
        hosts=[1, 2],
        in_process=False,
        digest=Option(False, "compute it in every frame"),
        frames=Option(40, "measured steps of each turn"),
        turns=3,
        systems=Option(list(SYSTEMS), choices=SYSTEMS),
        peers=PEERS_FOLDER,
        seconds=Option(5.0, "for each turn of a peer"),
    )
    table = Table(COLUMNS, as_json=arguments.json)
    for model in arguments.model:
        for agents in [n for n in arguments.agents if n] or SIZES[model]:
            for row in measured(arguments, model, agents):
                table.row(asdict(row))


if __name__ == "__main__":
    if sys.argv[1:2] == ["--task"]:
        chosen = Task.of(sys.argv[2:])
        print(json.dumps(on_bus(chosen) if chosen.hosts else in_process(chosen)))
        sys.exit(0)
    main()
