"""Models of the public comparison over the bus, with digests of all frames, and in one process.

    python -m benchmarks.comparison.bus [--models wolf_sheep flocking schelling]
        [--sizes large small] [--turns 3] [--runs 1] [--json]

On the bus, coordinator, host and clock are processes. The coordinator computes the digest of each
frame when a record would write it: while it waits for the answers to the next request. The digests
of the last frame must agree.
Milliseconds per frame: the median of the times between two frames, and the processor time of all
processes. `ratio` and `cpu ratio` divide those of the bus by those in one process, without digests.
Turns alternate; the medians of the turns are shown. On a busy machine, processes wait for each
other's turn, so only the processor time means anything.
"""

from __future__ import annotations

import json
import os
import statistics
import sys
import time
from collections.abc import Callable, Iterable
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, NamedTuple

from benchmarks.command import Option, Table, options
from benchmarks.comparison.models import flocking, schelling, wolf_sheep
from benchmarks.comparison.parameters import PARAMETERS
from benchmarks.comparison.stepping import members_of, stepped, world_of
from benchmarks.forked import Members, coordinator, forked
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.grammar.scene import Scene
from minerva_fast import Space

MODELS: Final[dict[str, Callable[[Any, int], Space]]] = {
    "wolf_sheep": wolf_sheep.meadow,
    "flocking": flocking.flock,
    "schelling": schelling.town,
}
WARM_UP: Final = 3
_CPUCLOCK_SCHED: Final = 2
"""The clock of a process, in Linux's `posix-timers.h`."""
COLUMNS: Final = {
    "model": "<11", "size": "<6", "ms": ">8.2f", "ms bus": ">8.2f", "ratio": ">6.1f",
    "cpu": ">8.2f", "cpu bus": ">8.2f", "cpu ratio": ">9.1f",
}  # fmt: skip


class Times(NamedTuple):
    """Milliseconds of a frame: time that passes, and processor time; the digest of the last one."""

    wall: float
    cpu: float
    digest: str


class Meter:
    """Notes the end of each frame, and with `digests` computes its digest when it is `idle`.

    `processes` are other ones whose processor time counts.
    """

    def __init__(self, *, digests: bool, processes: Iterable[int] = ()) -> None:
        self._digests = digests
        self._processes = [os.getpid(), *processes]
        self._ends: list[tuple[float, float]] = []
        self._scenes: list[Scene] = []

    def done(self, algorithm: FrameAlgorithm) -> None:
        """Note the end of a frame."""
        if self._digests:
            self._scenes.append(algorithm.scene)
        self._ends.append((time.perf_counter(), sum(map(_processor_time, self._processes))))

    def idle(self) -> None:
        """Compute the digests of the frames that have ended since the last call."""
        for scene in self._scenes:
            assert scene.digest
        self._scenes.clear()

    def times(self, algorithm: FrameAlgorithm) -> Times:
        """Times of a frame after the warm-up."""
        ends = self._ends[WARM_UP:]
        wall = statistics.median(after - before for (before, _), (after, _) in pairwise(ends))
        cpu = (ends[-1][1] - ends[0][1]) / (len(ends) - 1)
        return Times(1e3 * wall, 1e3 * cpu, str(algorithm.scene.digest))


def _processor_time(process: int) -> float:
    """Seconds of processor time of a process, by its clock in Linux."""
    return time.clock_gettime(~process << 3 | _CPUCLOCK_SCHED)


def in_process(space: Space, steps: int) -> Times:
    """A run in this process, without digests but that of the last frame."""
    meter, last = Meter(digests=False), list[FrameAlgorithm]()
    stepped(space, steps, 1, lambda algorithm: (meter.done(algorithm), last.append(algorithm)))
    return meter.times(last[-1])


def on_bus(space: Space, steps: int) -> Times:
    """A run on the bus, in processes of its own, because sessions do not survive a fork."""
    read, write = os.pipe()

    def body() -> None:
        os.close(read)
        Path(f"/dev/fd/{write}").write_text(json.dumps(_coordinated(space, steps)))

    child = forked(body)
    os.close(write)
    with os.fdopen(read) as pipe:
        answer = pipe.read()
    os.waitpid(child, 0)
    if not answer:
        sys.exit("the run on the bus has failed")
    return Times(*json.loads(answer))


def _coordinated(space: Space, steps: int) -> Times:
    members = Members("comparison", members_of(space))
    meter = Meter(digests=True, processes=members.pids.values())
    hub = coordinator(
        world_of(space, steps, 1),
        members.connect,
        lambda _: meter.done(hub.algorithm),
        idle=meter.idle,
    )
    hub.run()
    members.wait()
    return meter.times(hub.algorithm)


def main() -> None:
    """Measure in turns and print a table."""
    sizes = Option(["large", "small"], choices=["large", "small"])
    models = Option([*MODELS], choices=MODELS)
    arguments = options(__doc__, models=models, sizes=sizes, turns=3, runs=1)
    table = Table(COLUMNS, as_json=arguments.json)
    for model in arguments.models:
        for size in arguments.sizes:
            parameters = PARAMETERS[model, size]
            space, steps = MODELS[model](parameters, 1), arguments.runs * parameters.steps
            in_process(space, WARM_UP + 2)  # compiles
            turns = [
                (in_process(space, steps), on_bus(space, steps)) for _ in range(arguments.turns)
            ]
            if len({times.digest for turn in turns for times in turn}) > 1:
                sys.exit(f"{model}: the digests on the bus differ from those in one process")
            here, there = ([turn[side] for turn in turns] for side in (0, 1))
            wall, cpu = (_medians(here, there, what) for what in ("wall", "cpu"))
            table.row(
                {"model": model, "size": size, "ms": wall[0], "ms_bus": wall[1], "ratio": wall[2],
                 "cpu": cpu[0], "cpu_bus": cpu[1], "cpu_ratio": cpu[2]}
            )  # fmt: skip


def _medians(here: list[Times], there: list[Times], what: str) -> tuple[float, float, float]:
    """The medians in one process, on the bus, and of the ratios of both in a turn."""
    ours, bus = ([getattr(times, what) for times in side] for side in (here, there))
    ratios = [b / a for a, b in zip(ours, bus, strict=True)]
    return statistics.median(ours), statistics.median(bus), statistics.median(ratios)


if __name__ == "__main__":
    main()
