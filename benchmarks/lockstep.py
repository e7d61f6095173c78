"""Microseconds per frame of an empty lockstep, compared with other platforms in one run.

    python -m benchmarks.lockstep [--workers 1 2 4 8 16] [--systems minerva zenoh ...] [--json]
                                  [--plot FILE.png]

A frame: the coordinator requests events from K member processes, receives K empty replies, collects
the events and computes the digest of the string. The peers' scripts are in --peers
(`bench_<peer>.py` and a virtual environment `venvs/<peer>` for each); missing ones are skipped with
a message. `threads` is bare Zenoh with the threads that our sessions have. Absolute times depend on
the load of the machine; compare the ratios, which are from alternating turns in one run.
"""

from __future__ import annotations

import argparse
import gc
import json
import statistics
import sys
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from benchmarks.command import PEERS_FOLDER, PLOT, Table, options
from benchmarks.forked import Members, answered, coordinator, task
from benchmarks.plot import Line, plotted
from minerva_bus import Generator, Primitive, Vocabulary
from minerva_bus.frame.member_side import Member
from minerva_bus.frame.world_state import WorldSpec
from minerva_bus.runtime.session import CLIENT_THREADS, HUB_THREADS

WARM_UP = 100
FIGURES = ("us_per_step_median", "us_per_step_p99", "startup_s")
COLUMNS = {
    "system": "<10", "workers": ">7", "µs/frame": ">9.0f", "p99": ">9.0f", "start s": ">8.2f",
    "ratio": ">6.2f",
}  # fmt: skip
VOCABULARY = Vocabulary.of(Primitive("PNothing"))
BARE = "zenoh/bench_zenoh_bcast.py"
BARE_OPTIONS = ["--topo", "rstar", "--recv", "chan", "--wrecv", "chan"]
LABELS = {
    "minerva": "Minerva Bus", "zenoh": "bare Zenoh", "threads": "bare, our threads",
    "helics": "HELICS", "spade": "SPADE",
}  # fmt: skip
PEERS: dict[str, tuple[str, list[str]]] = {
    "zenoh": (BARE, BARE_OPTIONS),
    # The same with the threads of our sessions, which are faster than the usual ones.
    "threads": (BARE, [*BARE_OPTIONS, "--zruntime", HUB_THREADS, "--wzr", CLIENT_THREADS]),
    "mosaik": ("bench_mosaik.py", []),
    "helics": ("bench_helics.py", []),
    "dora": ("bench_dora.py", []),
    "spade": ("bench_spade.py", []),
}


@dataclass(frozen=True, slots=True)
class Row:
    """Results of one system with some number of members, and their ratio to Minerva Bus."""

    system: str
    workers: int
    figures: dict[str, float]
    ratio: float

    @property
    def step(self) -> float:
        """Microseconds per step."""
        return self.figures["us_per_step_median"]


class Idle(Generator):
    """A member that does nothing."""


def idle(name: str) -> Member:
    """An idle member with this name."""
    return Member(name, Idle())


def minerva(workers: int, steps: int) -> dict[str, float]:
    """Run the lockstep with the coordinator in this process and each member in its own."""
    began = time.perf_counter()
    names = [f"idle-{number}" for number in range(workers)]
    times: list[float] = []
    members = Members("lockstep", {name: partial(idle, name) for name in names})
    world = WorldSpec(
        "lockstep",
        VOCABULARY.read("PNothing"),
        VOCABULARY,
        frames=WARM_UP + steps,
        expected=frozenset(names),
    )
    gc.freeze()
    coordinator(world, members.connect, lambda _: times.append(time.perf_counter())).run()
    members.wait()
    frames = [1e6 * (b - a) for a, b in zip(times[WARM_UP - 1 :], times[WARM_UP:], strict=False)]
    return {
        "us_per_step_median": statistics.median(frames),
        "us_per_step_p99": statistics.quantiles(frames, n=100)[98],
        "startup_s": times[0] - began,
    }


def peer(name: str, folder: Path, workers: int, steps: int) -> dict[str, float] | str:
    """Run one peer; returns its results, or the reason why there are none."""
    script, options = PEERS[name]
    python = folder / "venvs" / name / "bin" / "python"
    if script == BARE:
        python = Path(sys.executable)
    if not (folder / script).is_file():
        return f"{folder / script} is not there"
    if not python.is_file():
        return f"{python} is not there"
    words = [str(python), Path(script).name, "--workers", str(workers), "--steps", str(steps)]
    result = answered([*words, "--payload", "100", *options], (folder / script).parent, 300)
    return result if isinstance(result, str) else {key: result[key] for key in FIGURES}


def measure(system: str, peers: Path, workers: int, steps: int) -> dict[str, float] | str:
    """Measure one system once."""
    if system != "minerva":
        return peer(system, peers, workers, steps)
    return task("benchmarks.lockstep", workers, steps)


def best(rows: list[dict[str, float]]) -> dict[str, float]:
    """Medians of the results over some turns."""
    return {key: statistics.median(row[key] for row in rows) for key in rows[0]}


def main() -> None:
    """Measure in turns and print a table."""
    arguments = options(
        __doc__,
        workers=[1, 2, 4, 8, 16],
        steps=1000,
        turns=3,
        systems=["minerva", *PEERS],
        peers=PEERS_FOLDER,
        plot=PLOT,
    )
    table = Table(COLUMNS, as_json=arguments.json)
    rows = [row for workers in arguments.workers for row in report(arguments, workers, table)]
    if arguments.plot is not None:
        plotted(arguments.plot, lines_of(rows), "members", "time of a frame, µs (median)")


def report(arguments: argparse.Namespace, workers: int, table: Table) -> list[Row]:
    """Measure and print all systems at one size; ratios are to Minerva Bus."""
    turns: dict[str, list[dict[str, float]]] = {}
    missing: dict[str, str] = {}
    for _ in range(arguments.turns):
        for system in arguments.systems:
            if system in missing:
                continue
            result = measure(system, arguments.peers, workers, arguments.steps)
            if isinstance(result, str):
                missing[system] = result
            else:
                turns.setdefault(system, []).append(result)
    ours = best(turns["minerva"])["us_per_step_median"] if "minerva" in turns else 0.0
    rows: list[Row] = []
    for system, taken in turns.items():
        figures = best(taken)
        ratio = figures["us_per_step_median"] / ours if ours else 0.0
        rows.append(Row(system, workers, figures, ratio))
        table.row({"system": system, "workers": workers, **figures, "ratio": ratio})
    for system, why in missing.items():
        print(f"{system:10} {workers:7} left out: {why}", file=sys.stderr)
    return rows


def lines_of(rows: list[Row]) -> list[Line]:
    """A line for each system: microseconds per step over the number of members."""
    lines: list[Line] = []
    for system in dict.fromkeys(row.system for row in rows):
        own_rows = [row for row in rows if row.system == system]
        x, y = [row.workers for row in own_rows], [row.step for row in own_rows]
        lines.append(Line("an empty frame in lockstep", LABELS.get(system, system), x, y))
    return lines


if __name__ == "__main__":
    if sys.argv[1:2] == ["--task"]:
        print(json.dumps(minerva(*map(int, sys.argv[2:4]))))
    else:
        main()
