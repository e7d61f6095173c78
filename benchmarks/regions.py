"""Frames per second and CPU time of one world with one coordinator and as regions in processes.

    python -m benchmarks.regions [--agents 1000] [--work 0 100] [--regions 0 1 2 4] [--json]

Walkers on a line, a metre apart, in regions of equal width. In each frame, each one computes
(`work` steps of a loop in Python) and moves, and 1 in 20 calls its neighbour. Regions 0 is one
coordinator with its members in the same process (--in-process). Medians of the turns, which
alternate. CPU time is that of all processes, without the start: the difference between a run and
one of a tenth of its frames. Bytes are those that one region sends to another one in a frame, on
average.
"""

from __future__ import annotations

import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, Final

from benchmarks.command import Option, Table, options
from minerva_bus import Agent, Context, Event, EventType, Metres, Vocabulary, on

COLUMNS: Final = {"agents": ">7,", "work": ">6", "regions": ">8", "frames/s": ">9.1f",
                  "CPU ms a frame": ">15.2f", "bytes a pair": ">13,"}  # fmt: skip

eStep = EventType("eStep")
eCall = EventType("eCall", x=Metres)


class Walker(Agent, symbol="AWalker"):
    """Computes, moves and sometimes calls."""

    x: Metres = 0.0
    heard: int = 0
    work: int = 0

    @on("eStep")
    def walk(self, step: Event, moment: Context) -> None:
        """Move by the result of a computation."""
        value = self.x
        for _ in range(self.work):
            value = value * 0.999 + 0.5
        self.x += moment.chance.uniform(-1.0, 1.0) + 1e-12 * value
        if moment.chance.chance(0.05):
            moment.emit(eCall(x=self.x, receivers=[f"w{int(self.id[1:]) + 1}"]))

    @on("eCall")
    def hear(self, call: Event, moment: Context) -> None:
        """Count a call."""
        self.heard += 1


vocabulary = Vocabulary.of(eStep, eCall, Walker)


def world(
    folder: Path,
    agents: int,
    work: int,
    regions: int,
    lag: int = 0,
    move_every: int = 1,
    clock: str = 'service = "each"\nevent = "eStep"\n',
) -> Path:
    """A world file with agents on a line, and borders between regions of equal width.

    `clock` is the table of the generator that lets them step.
    """
    string = " · ".join(f"AWalker#w{n}<x={n}, work={work}>" for n in range(agents))
    borders = [round(agents * n / regions, 3) for n in range(1, regions)] if regions > 1 else []
    table = f"[regions]\ngrid = {{ x = {borders} }}\n" if regions else ""
    table += f"lag = {lag}\nmove_every = {move_every}\n" if lag else ""
    path = folder / f"line-{regions}-{lag}.toml"
    path.write_text(
        f'[world]\nvocabulary = "benchmarks.regions:vocabulary"\nseed = 7\nstring = "{string}"\n'
        '[process.walkers]\nagents = "benchmarks.regions:Walker"\n'
        f"[process.steps]\n{clock}{table}"
    )
    return path


def run(path: Path, frames: int, *words: str) -> tuple[dict[str, Any], float]:
    """The summary of a run, and the CPU seconds of all of its processes."""
    before = _cpu()
    command = [sys.executable, "-m", "minerva_bus", "run", str(path), "--rate", "0", "--json"]
    done = subprocess.run(
        [*command, "--frames", str(frames), *words],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).resolve().parents[1])},
    )
    return json.loads(done.stdout), _cpu() - before


def _cpu() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def measured(path: Path, frames: int, regions: int) -> dict[str, float]:
    """Frames per second, CPU milliseconds of a frame, and bytes of a parcel."""
    words = () if regions else ("--in-process",)
    _, start = run(path, frames // 10, *words)
    summary, whole = run(path, frames, *words)
    return {
        "frames_per_second": summary["frames_per_second"],
        "cpu_ms": 1e3 * (whole - start) / (frames - frames // 10),
        "parcel_bytes": summary.get("parcel_bytes", 0),
    }


def main() -> None:
    """Print a row for each amount of work and number of regions."""
    given = options(
        __doc__, agents=[1000], work=[0, 100], regions=[0, 1, 2, 4],
        frames=Option(200, "of each turn"), turns=3,
    )  # fmt: skip
    table = Table(COLUMNS, as_json=given.json)
    with tempfile.TemporaryDirectory() as folder:
        for agents in given.agents:
            for work in given.work:
                paths = {n: world(Path(folder), agents, work, n) for n in given.regions}
                turns = [
                    {n: measured(path, given.frames, n) for n, path in paths.items()}
                    for _ in range(given.turns)
                ]
                for n in given.regions:
                    middle = {
                        name: round(statistics.median(turn[n][name] for turn in turns), 2)
                        for name in turns[0][n]
                    }
                    table.row({"agents": agents, "work": work, "regions": n, **middle})


if __name__ == "__main__":
    main()
