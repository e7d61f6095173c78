"""CPU time and calls of a frame in one process that gives an event to one agent, or to none.

    python -m benchmarks.frames [--frames 3000] [--turns 3] [--json]

`nothing` has a host and no generator; `no event` a generator without events; `agent` gives one
event to an agent; `space` one to the space of small flocking, of `benchmarks.comparison`. `us` is
the CPU time that a tenth of the frames took at most, `calls` the Python functions that a frame
calls, which does not depend on the load of the machine.
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from types import FrameType
from typing import Any, Final

from benchmarks.command import Table, options
from benchmarks.comparison.models.flocking import flock
from benchmarks.comparison.parameters import PARAMETERS, Flocking
from benchmarks.comparison.stepping import eStep, members_of, world_of
from minerva_bus import Agent, Event, Generator, Tick, Vocabulary, on
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.member_side import Member
from minerva_bus.frame.world_state import WorldSpec
from minerva_bus.runtime.runner import InProcessRunner
from minerva_bus.world.event_collection import Priority

WARM_UP: Final = 50
COUNTED: Final = 100
"""Frames whose calls are counted."""
COLUMNS: Final = {"frame": "<10", "us": ">8.1f", "calls": ">8.1f"}


@dataclass(frozen=True, slots=True)
class Row:
    """One line of the table."""

    frame: str
    us: float
    calls: float


class Silent(Generator, events=("eStep",)):
    """Is asked in every frame, and has no event."""

    def generate(self, tick: Tick) -> tuple[()]:
        return ()


class Steps(Generator, events=("eStep",)):
    """Has one event in every frame."""

    def generate(self, tick: Tick) -> Iterator[Event]:
        yield eStep()


class Counter(Agent, symbol="ACounter"):
    """Counts its events."""

    count: int = 0

    @on("eStep")
    def step(self, step: Event, moment: Any) -> None:
        self.count += 1


def with_agent(generator: type[Generator] | None) -> InProcessRunner:
    """A world with one agent, and perhaps a generator."""
    members = [Member("host", agents=[Counter])]
    members += [Member("clock", generator())] if generator is not None else []
    vocabulary = Vocabulary.of(eStep, Counter)
    world = WorldSpec("frames", Counter("a").string, vocabulary, seed=1, order=Priority(("eStep",)),
                  expected=frozenset(member.name for member in members))  # fmt: skip
    return InProcessRunner(FrameAlgorithm(world), members)


def with_space() -> InProcessRunner:
    """A world with small flocking."""
    parameters = PARAMETERS["flocking", "small"]
    assert isinstance(parameters, Flocking)
    space = flock(parameters, 1)
    members = [make() for make in members_of(space).values()]
    return InProcessRunner(FrameAlgorithm(world_of(space, 0, 1)), members)


CASES: Final[dict[str, Callable[[], InProcessRunner]]] = {
    "nothing": lambda: with_agent(None),
    "no event": lambda: with_agent(Silent),
    "agent": lambda: with_agent(Steps),
    "space": with_space,
}


def measured(make: Callable[[], InProcessRunner], frames: int) -> tuple[float, float]:
    """Microseconds and calls of a frame."""
    runner = make()
    runner.start()
    for _ in range(WARM_UP):
        runner.handle(s.Begin())
    calls = counted(runner)
    times: list[int] = []
    for _ in range(frames):
        began = time.thread_time_ns()
        runner.handle(s.Begin())
        times.append(time.thread_time_ns() - began)
    return statistics.quantiles(times, n=10)[0] / 1e3, calls


def counted(runner: InProcessRunner) -> float:
    """The Python functions that a frame calls."""
    calls = 0

    def count(_: FrameType, event: str, __: object) -> None:
        nonlocal calls
        calls += event == "call"

    sys.setprofile(count)
    try:
        for _ in range(COUNTED):
            runner.handle(s.Begin())
    finally:
        sys.setprofile(None)
    return calls / COUNTED


def main() -> None:
    """Measure, and print a table."""
    arguments = options(__doc__, frames=3000, turns=3)
    results: dict[str, list[tuple[float, float]]] = {}
    for _ in range(arguments.turns):
        for name, make in CASES.items():
            results.setdefault(name, []).append(measured(make, arguments.frames))
    table = Table(COLUMNS, as_json=arguments.json)
    for name, taken in results.items():
        times, calls = zip(*taken, strict=True)
        table.row(asdict(Row(name, statistics.median(times), calls[0])))


if __name__ == "__main__":
    main()
