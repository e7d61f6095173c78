"""Frame time when most of the string does not change.

    python -m benchmarks.incremental [--what figures separate idle bytes] [--sizes 1000 ...]
        [--in-process] [--digest] [--plot FILE] [--json]

Ten agents move in every frame. The rest of the string is one of:

    figures    `size` primitives of one kind in sequence
    separate   `size` primitives of two alternating kinds, which cannot be columns
    idle       `size` agents of a kind that no event addresses
    bytes      one primitive with a matrix of `size` bytes

The rest does not change, so a frame should take as long as with a small string. A row is the median
over the frames of some turns. Its ratio is to the smallest size; the sizes alternate within this
one run.
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
from itertools import pairwise, product
from typing import Final

import numpy as np

from benchmarks.command import PLOT, Option, Table, options
from benchmarks.forked import Members, coordinator, task
from benchmarks.models.events import Clock, eStep
from benchmarks.plot import Line, plotted
from minerva_bus import Agent, Cells, Context, Event, Primitive, Scene, Vocabulary, on
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.member_side import Member
from minerva_bus.frame.world_state import WorldSpec
from minerva_bus.runtime.runner import InProcessRunner

WARM_UP: Final = 20
ACTIVE: Final = 10
MEMBERS: Final = ("clock", "host")
COLUMNS: Final = {
    "what": "<9",
    "size": ">9,",
    "µs/frame": ">9.0f",
    "p90": ">9.0f",
    "ratio": ">6.2f",
}
LABELS: Final = {
    "figures": "figures of one shape",
    "separate": "separate nodes",
    "idle": "idle agents",
    "bytes": "bytes of a matrix",
}
LARGEST: Final = {"separate": 100_000}
"""Maximum sizes: larger ones take long to start and give no new information."""

PDot = Primitive("PDot", size=float)
PBox = Primitive("PBox", size=float)
PMap = Primitive("PMap", cells=Cells)


class Walker(Agent, symbol="AWalker"):
    """Moves in every frame."""

    x: float = 0.0

    @on("eStep")
    def step(self, step: Event, moment: Context) -> None:
        self.x += 1.0


class Stone(Agent, symbol="AStone"):
    """Processes no events."""

    x: float = 0.0
    y: float = 0.0


VOCABULARY = Vocabulary.of(eStep, PDot, PBox, PMap, Walker, Stone)


@dataclass(frozen=True, slots=True)
class Row:
    """One line of the table."""

    what: str
    size: int
    us_per_frame: float
    us_p90: float
    ratio: float


def still(what: str, size: int) -> Scene:
    """The unchanging part of the string."""
    sizes = np.arange(size) / 8
    if what == "figures":
        return PDot(size=sizes)
    if what == "separate":
        dot, box = PDot(1.0).pieces, PBox(1.0).pieces
        return Scene((dot + box) * (size // 2))
    if what == "idle":
        return Stone.many("s", size, x=sizes, y=sizes)
    side = max(1, round((size / 2) ** 0.5))  # two bytes per cell
    return PMap(np.zeros((side, side), np.int16))


def world(what: str, size: int, frames: int) -> WorldSpec:
    """A world of ten walkers and an unchanging part."""
    walkers = Scene(tuple([Walker(f"w{n}", x=float(n)).string.pieces[0] for n in range(ACTIVE)]))
    return WorldSpec(
        "incremental",
        still(what, size) + walkers,
        VOCABULARY,
        frames=WARM_UP + frames,
        expected=frozenset(MEMBERS),
    )


def participant(name: str) -> Member:
    """The clock, or the host of both kinds."""
    return Member(name, Clock()) if name == "clock" else Member(name, None, HOSTED)


HOSTED: Final = [Walker, Stone]


def on_bus(what: str, size: int, frames: int) -> list[float]:
    """Microseconds of each frame over the bus."""
    times: list[float] = []
    members = Members("incremental", {name: partial(participant, name) for name in MEMBERS})
    hub = coordinator(
        world(what, size, frames), members.connect, lambda _: times.append(time.perf_counter())
    )
    hub.run()
    members.wait()
    return microseconds(times)


def in_process(what: str, size: int, frames: int, digest: bool = False) -> list[float]:
    """Microseconds of each frame in this process."""
    times: list[float] = []

    def watch(instruction: s.Instruction) -> None:
        if isinstance(instruction, s.FrameDone):
            if digest:
                assert algorithm.scene.digest
            times.append(time.perf_counter())

    algorithm = FrameAlgorithm(world(what, size, frames))
    runner = InProcessRunner(algorithm, [participant(name) for name in MEMBERS], watch)
    runner.start()
    while runner.ended is None:
        runner.handle(s.Begin())
    return microseconds(times)


def microseconds(times: list[float]) -> list[float]:
    """Durations of the frames after the warm-up."""
    late = times[WARM_UP - 1 :]
    return [1e6 * (b - a) for a, b in pairwise(late)]


def measured(what: str, size: int, arguments: argparse.Namespace) -> list[float]:
    """Durations of the frames of one turn, in a separate process."""
    way = "in-process" if arguments.in_process else "bus"
    way = "digest" if arguments.digest else way
    return task("benchmarks.incremental", way, what, size, arguments.frames)


def rows_of(what: str, arguments: argparse.Namespace) -> list[Row]:
    """The rows of all sizes of one variant, measured in alternating turns."""
    sizes = [size for size in arguments.sizes if size <= LARGEST.get(what, size)]
    frames: dict[int, list[list[float]]] = {size: [] for size in sizes}
    for _, size in product(range(arguments.turns), sizes):
        frames[size].append(measured(what, size, arguments))
    middle = {size: [statistics.median(turn) for turn in turns] for size, turns in frames.items()}
    least = middle[sizes[0]]
    return [
        Row(
            what,
            size,
            statistics.median(middle[size]),
            statistics.median(statistics.quantiles(turn, n=10)[8] for turn in turns),
            statistics.median(a / b for a, b in zip(middle[size], least, strict=True)),
        )
        for size, turns in frames.items()
    ]


def main(words: Sequence[str]) -> None:
    """Measure in turns and print a table."""
    things = list(LABELS)
    arguments = options(
        __doc__,
        words,
        what=Option(things, choices=things),
        sizes=[10**n for n in range(3, 7)],
        in_process=False,
        digest=Option(False, "in process, with the digest of each frame"),
        frames=400,
        turns=5,
        plot=PLOT,
    )
    table = Table(COLUMNS, as_json=arguments.json)
    lines: list[Line] = []
    for what in arguments.what:
        rows = rows_of(what, arguments)
        for row in rows:
            table.row(asdict(row))
        x, y = [row.size for row in rows], [row.us_per_frame for row in rows]
        lines.append(Line("a frame of ten moving agents", LABELS[what], x, y))
    if arguments.plot:
        plotted(
            arguments.plot, lines, "size of what does not change", "time of a frame, µs (median)"
        )


def turn(way: str, what: str, size: str, frames: str) -> list[float]:
    """Frame durations of one turn."""
    if way == "bus":
        return on_bus(what, int(size), int(frames))
    return in_process(what, int(size), int(frames), way == "digest")


if __name__ == "__main__":
    if sys.argv[1:2] == ["--task"]:
        print(json.dumps(turn(*sys.argv[2:])))
        sys.exit(0)
    main(sys.argv[1:])
