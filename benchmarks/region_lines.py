"""Frames per second of a world over slow lines, with one coordinator and as regions elsewhere.

    python -m benchmarks.region_lines [--delay 1 5 50] [--regions 0 2 4] [--lag 0 1 3] [--json]

A proxy delays both directions of each line by `delay` ms: between the coordinator and each process,
and between each two regions. Regions 0 is one coordinator with the generator and one host on other
machines. The world is that of benchmarks.regions, whose agents move to other regions before every
`every`-th frame if there is a lag. `predicted` is 1 / max(w, (w + 2 delay) / (lag + 1)), with the
time w of a frame without a delay, measured in the same turns: a frame lasts a round trip between
the coordinator and the regions, which a lag of n divides by n + 1.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING, Any, Final

from benchmarks.command import Option, Table, options
from benchmarks.regions import world
from minerva_bus.errors import BusError
from minerva_bus.launch.registry import find
from minerva_bus.runtime.endpoints import check_endpoint
from minerva_bus.testing.proxy import Proxy, slow_line

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

COLUMNS: Final = {"delay ms": ">9", "regions": ">8", "lag": ">4", "frames/s": ">9.1f",
                  "predicted": ">10.1f"}  # fmt: skip
MEMBER: Final = "member"
"""First word of the command line of a process whose links from other regions are delayed."""

ROOT: Final = Path(__file__).resolve().parents[1]


def run_member(milliseconds: float, words: Sequence[str]) -> None:
    """Run `minerva` with these words; a region announces a delayed endpoint as its own."""
    from minerva_bus.cli.main import main as minerva
    from minerva_bus.launch.regions import process as region_process
    from minerva_bus.runtime.region_links import RegionLinks

    class Delayed(RegionLinks):
        def __init__(self, *args: Any, **more: Any) -> None:
            super().__init__(*args, **more)
            port = check_endpoint(self.endpoint).port
            self._proxy = Proxy(port, slow_line(Random(1), milliseconds / 1e3))
            self.endpoint = f"tcp/127.0.0.1:{self._proxy.port}"

    region_process.RegionLinks = Delayed
    sys.argv = ["minerva", *words]
    minerva()


@contextmanager
def process(*words: str, **streams: Any) -> Iterator[subprocess.Popen[str]]:
    """A process of Python that is terminated at the end."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    running = subprocess.Popen([sys.executable, *words], text=True, env=environment, **streams)
    try:
        yield running
    finally:
        running.terminate()
        running.wait()


def port_of(name: str, coordinator: subprocess.Popen[str]) -> int:
    """The port of a world that has just been started."""
    while coordinator.poll() is None:
        with suppress(BusError):
            return check_endpoint(find(name).endpoint).port
        time.sleep(0.1)
    raise SystemExit(f"{name} has ended before it began")


def frames_per_second(path: Path, regions: int, milliseconds: float, frames: int) -> float:
    """Frames per second of one run, without its start."""
    name = f"{path.stem}-{os.getpid()}"
    alone = "-m", "minerva_bus", "run", str(path), "--coordinator-only", "--json", "--rate", "0"
    counted = "--frames", str(frames), "--name", name
    names = [f"region-{n}" for n in range(regions)] or ["walkers", "steps"]
    shared = ("--regions", str(regions)) if regions else ()
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
    with ExitStack() as opened:
        coordinator = opened.enter_context(process(*alone, *counted, *shared, **pipes))
        assert coordinator.stdout is not None
        port = port_of(name, coordinator)
        line = opened.enter_context(Proxy(port, slow_line(Random(1), milliseconds / 1e3)))
        there = "--connect", f"tcp/127.0.0.1:{line.port}", "--world", name
        member = "-m", "benchmarks.region_lines", MEMBER, str(milliseconds), "attach", str(path)
        for each in names:
            words = *member, "--process", each, *shared, *there
            opened.enter_context(process(*words, stderr=subprocess.DEVNULL))
        summary = json.loads(coordinator.stdout.read())
        if summary["frames"] < frames:
            raise SystemExit(f"{name} has ended early: {summary['ended']}")
        return summary["frames_per_second"]


def main() -> None:
    """Print a row for each delay and number of regions."""
    given = options(
        __doc__, delay=[1, 5, 50], regions=[0, 2, 4], lag=[0, 1, 3], every=50, agents=100,
        frames=Option(100, "of each turn"), turns=3,
    )  # fmt: skip
    table = Table(COLUMNS, as_json=given.json)
    with tempfile.TemporaryDirectory() as folder:
        paths = {
            (n, lag): world(Path(folder), given.agents, 0, n, lag, given.every)
            for n in given.regions
            for lag in (given.lag if n > 1 else [0])
        }
        alone: dict[tuple[int, int], float] = {}
        for delay in [0, *given.delay]:
            turns = [
                {
                    of: frames_per_second(path, of[0], delay, given.frames)
                    for of, path in paths.items()
                }
                for _ in range(given.turns)
            ]
            for n, lag in paths:
                rate = statistics.median(turn[n, lag] for turn in turns)
                work = 1 / alone.setdefault((n, lag), rate)
                longest = max(work, (work + 2e-3 * delay) / (lag + 1))
                row = {"delay ms": delay, "regions": n, "lag": lag, "frames/s": rate}
                table.row({**row, "predicted": 1 / longest})


if __name__ == "__main__":
    if sys.argv[1:2] == [MEMBER]:
        run_member(float(sys.argv[2]), sys.argv[3:])
    else:
        main()
