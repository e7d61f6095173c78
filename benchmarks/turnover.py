"""CPU time of a frame with births and deaths, in one process, beside that of its activity.

    python -m benchmarks.turnover [--agents 10000 100000] [--frames 60] [--turns 3] [--json]

The sheep of docs/populations.md, in the form for populations: normal steps, grazing, births and
deaths. The activity is the method with its random numbers; the rest of a frame is the evolution
around it and the coordinator. Medians of the frames, and of the turns; compare the ratios, because
times depend on the load of the machine.
"""

from __future__ import annotations

import statistics
import time
from typing import Final

import numpy as np

from benchmarks.command import Option, Table, options
from extensions.fast.benchmarks.compiled import eDay, live_together
from minerva_bus import (
    Agent,
    BatchContext,
    Event,
    Generator,
    Metres,
    Scene,
    Tick,
    Vocabulary,
    on,
)
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.member import Member
from minerva_bus.frame.world_state import WorldSpec
from minerva_bus.runtime.runner import InProcessRunner

WARM_UP: Final = 5
COLUMNS: Final = {"agents": ">9,", "frame ms": ">8.2f", "activity ms": ">11.2f",
                  "rest ms": ">7.2f", "ratio": ">6.2f"}  # fmt: skip

activity: list[float] = []
"""CPU seconds of each call of the method below."""


class Sheep(Agent, symbol="ASheep"):
    """Grazes, gives birth and dies."""

    x: Metres = 0.0
    y: Metres = 0.0
    energy: float = 5.0
    births: int = 0

    @on("eDay", population=True)
    def live(self, day: Event, moment: BatchContext) -> None:
        began = time.thread_time()
        live_together(self, day, moment)
        activity.append(time.thread_time() - began)


class Days(Generator, events=("eDay",)):
    """The clock."""

    def generate(self, tick: Tick) -> tuple[Event, ...]:
        return (eDay(grass=2.0),)


def flock(agents: int) -> Scene:
    """Sheep at random places, with any energy."""
    chance = np.random.default_rng(1)
    x, y = chance.uniform(0, 30, (2, agents))
    return Sheep.many("s", agents, x=x, y=y, energy=chance.uniform(0, 8, agents))


def measured(agents: int, frames: int) -> dict[str, float]:
    """Medians of frames: seconds of the frame and of its activity, and the newborns."""
    world = WorldSpec(
        "turnover", flock(agents), Vocabulary.of(eDay, Sheep), expected=frozenset(("days", "host"))
    )
    members = [Member("days", Days()), Member("host", agents=[Sheep])]
    runner = InProcessRunner(FrameAlgorithm(world), members)
    runner.start()
    activity.clear()
    seconds: list[float] = []
    for _ in range(WARM_UP + frames):
        began = time.thread_time()
        runner.handle(s.Begin())
        seconds.append(time.thread_time() - began)
    return {
        "frame": statistics.median(seconds[WARM_UP:]),
        "activity": statistics.median(activity[-frames:]),
    }


def main() -> None:
    """Print a row for each number of agents."""
    given = options(
        __doc__, agents=[10_000, 100_000], frames=Option(60, "of each turn"), turns=3
    )  # fmt: skip
    table = Table(COLUMNS, as_json=given.json)
    for agents in given.agents:
        turns = [measured(agents, given.frames) for _ in range(given.turns)]
        middle = {name: statistics.median(turn[name] for turn in turns) for name in turns[0]}
        frame, own = 1e3 * middle["frame"], 1e3 * middle["activity"]
        table.row({"agents": agents, "frame_ms": frame, "activity_ms": own,
                   "rest_ms": frame - own, "ratio": frame / own})  # fmt: skip


if __name__ == "__main__":
    main()
