"""Frames per second of a world over slow lines, with one coordinator and as regions elsewhere.

    python -m benchmarks.region_lines [--delay 0 1 5 50] [--lost 0 1] [--regions 0 2 4 8]
                                      [--lag 0 1 3] [--turns 3] [--json]

The coordinator and each process are hosts of their own: network namespaces, whose lines delay each
packet by `delay` ms in each direction and lose `lost` percent of all (benchmarks/ip_lines.py, which
needs root). Regions 0 is one coordinator with the generator and one host on other machines. The
world is that of benchmarks.regions, whose agents move to other regions before every `every`-th
frame if there is a lag. It runs once, while the lines change in `turns`, for `frames` frames each.

`frames/s` is the best of the turns, since other processes only make it slower, and `median` their
median. `expected` is 1 / max(w, (w + 2 delay) / (lag + 1)), with the time w of a frame of the same
regions without a delay: a frame lasts a round trip between the coordinator and the regions, of
which lag + 1 are under way at the same time. With one coordinator it has two round trips: to the
generator, and to the host. Lost packets are not expected.
"""

from __future__ import annotations

import json
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Final

from benchmarks.command import Option, Table, options
from benchmarks.ip_lines import Lines, run
from benchmarks.regions import eStep, world
from minerva_bus import Event, Generator, Tick

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

COLUMNS: Final = {"delay ms": ">9", "lost %": ">7", "regions": ">8", "lag": ">4",
                  "frames/s": ">9.1f", "median": ">7.1f", "expected": ">9.1f"}  # fmt: skip
MINERVA: Final = (sys.executable, "-m", "minerva_bus")
ROOT: Final = Path(__file__).resolve().parents[1]
TIMES: Final = "MINERVA_BENCHMARK_TIMES"
"""Variable with the file for the times of frames, in one process of the world."""

CLOCK: Final = 'service = "benchmarks.region_lines:Steps"\n'
PATIENCE: Final = 120.0
SETTLED: Final = 12
"""Frames before those that are measured, after the lines have changed."""


class Steps(Generator, events=("eStep",)):
    """Lets agents step, and notes the time of each frame."""

    def __init__(self) -> None:
        path = os.environ.get(TIMES)
        self._path = None if path is None else Path(path)

    def generate(self, tick: Tick) -> tuple[Event, ...]:
        """One step."""
        if self._path is not None:
            with self._path.open("a") as times:
                times.write(f"{time.monotonic()}\n")
        return (eStep(),)


@dataclass(frozen=True, slots=True)
class Setting:
    """Lines with a delay in milliseconds, which lose some percent."""

    delay: float
    lost: float


NO_DELAY: Final = Setting(0.0, 0.0)


@contextmanager
def process(path: Path, *words: str, **more: str) -> Iterator[subprocess.Popen[bytes]]:
    """A process that is terminated at the end; `more` are variables.

    Its output is in a file, its errors in one that ends with `.log`.
    """
    environment = {**os.environ, "PYTHONPATH": str(ROOT), **more}
    with path.open("w") as output, path.with_suffix(".log").open("a") as errors:
        running = subprocess.Popen(words, env=environment, stdout=output, stderr=errors)
    try:
        yield running
    finally:
        running.terminate()
        running.wait()


class RunningWorld:
    """A world whose coordinator is host 0, and each process another one.

    `coordinator` is its process. So many hosts are `spare`: regions may run there later.
    """

    def __init__(
        self,
        folder: Path,
        path: Path,
        regions: int,
        opened: ExitStack,
        *words: str,
        spare: int = 0,
    ) -> None:
        """`words` are options of the coordinator."""
        self._opened = opened
        self._runtime = str(folder / "runtime")
        self._path, self._regions = path, regions
        self._times = folder / f"{path.stem}.times"
        roles = {f"region-{n}": "region" for n in range(regions)}
        roles = roles or {"steps": "generator", "walkers": "agent"}
        self.lines = opened.enter_context(Lines(1 + len(roles) + spare))
        self._keys, self._at = folder / f"{path.stem}.keys", f"tls/{self.lines.address(0)}:7447"
        keys = "--dir", str(self._keys)
        run(*MINERVA, "keys", "init", *keys, "--host", self.lines.address(0))
        spares = [self.lines.address(1 + len(roles) + n) for n in range(spare)]
        for host, (name, role) in enumerate(roles.items(), 1):
            hosts = ",".join([self.lines.address(host), *spares])
            run(*MINERVA, "keys", "issue", name, "--role", role, *keys, "--host", hosts)
        alone = "run", str(path), "--coordinator-only", "--listen", self._at
        alone = *alone, "--regions", str(regions), "--keys", str(self._keys), *words
        self.processes: dict[str, subprocess.Popen[bytes]] = {}
        self.coordinator = self._start("coordinator", 0, *alone)
        # Processes that nobody answers end at once.
        place, end = Path(self._runtime) / f"{path.stem}.json", time.monotonic() + PATIENCE
        while not place.exists():
            if self.coordinator.poll() is not None or time.monotonic() > end:
                raise SystemExit(f"{path.stem} does not begin: {self._why(['coordinator'])}")
            time.sleep(0.05)
        for host, name in enumerate(roles, 1):
            self.attach(name, host)

    def attach(self, name: str, host: int, *words: str) -> subprocess.Popen[bytes]:
        """Start the process of the world with this name on a host."""
        shared = "--connect", self._at, "--keys", f"{self._keys}/{name}.pem", *words
        if self._regions:
            link = f"tls/{self.lines.address(host)}:7450"
            shared = *shared, "--regions", str(self._regions), "--link", link
        words = "attach", str(self._path), "--process", name, *shared
        started = self.processes[name] = self._start(name, host, *words)
        return started

    def _start(self, name: str, host: int, *words: str) -> subprocess.Popen[bytes]:
        variables = {"MINERVA_RUNTIME_DIR": self._runtime}
        if host == 1:
            variables[TIMES] = str(self._times)
        inside = self.lines.inside(host)
        started = process(self._output(name), *inside, *MINERVA, *words, **variables)
        return self._opened.enter_context(started)

    def _output(self, name: str) -> Path:
        return self._times.with_name(f"{self._times.stem}-{name}.json")

    def ended(self) -> tuple[str, int]:
        """End the world; returns its digest and number of frames. It must have `--json`."""
        self.coordinator.send_signal(signal.SIGINT)
        self.coordinator.wait(PATIENCE)
        summary = json.loads(self._output("coordinator").read_text())
        return summary["digest"], summary["frames"]

    def frames_per_second(self, setting: Setting, frames: int) -> float:
        """The mean over some frames, after the lines have this setting."""
        self.lines.delay, self.lines.lost = setting.delay / 1e3, setting.lost / 100
        first = len(self.noted()) + SETTLED
        times = self.after(first + frames)
        return frames / (times[first + frames] - times[first])

    def noted(self) -> list[float]:
        """The times at which frames have begun, on the monotonic clock."""
        text = self._times.read_text() if self._times.exists() else ""
        return [float(line) for line in text.split("\n")[:-1]]

    def after(self, frame: int) -> list[float]:
        """The times of frames up to this one; waits until it has begun."""
        seen, end = -1, time.monotonic() + PATIENCE
        while len(times := self.noted()) <= frame:
            if len(times) > seen:
                seen, end = len(times), time.monotonic() + PATIENCE
            present = {"coordinator": self.coordinator, **self.processes}
            ended = [name for name, each in present.items() if each.poll() is not None]
            if ended or time.monotonic() > end:
                raise SystemExit(
                    f"{self._times.stem} stands still at frame {seen}: {self._why(ended)}"
                )
            time.sleep(0.05)
        return times

    def _why(self, ended: Sequence[str]) -> str:
        logs = [self._output(name).with_suffix(".log") for name in ended]
        lines = [
            f"{log.stem}: {line}" for log in logs for line in log.read_text().splitlines()[-9:]
        ]
        return "\n".join(["no process has ended" if not ended else "these have ended", *lines])


def print_rows(
    table: Table, regions: int, lag: int, rates: Mapping[Setting, Sequence[float]]
) -> None:
    """Print a row for each setting of the lines, and what is expected."""
    work, trips = 1 / max(rates[NO_DELAY]), 1 if regions else 2
    for setting, measured in rates.items():
        longest = max(work, (work + 2e-3 * trips * setting.delay) / (lag + 1))
        row = {"delay ms": setting.delay, "lost %": setting.lost, "regions": regions, "lag": lag}
        row |= {"frames/s": max(measured), "median": statistics.median(measured)}
        table.row({**row, "expected": 1 / longest})


def main() -> None:
    """Print the rows of each world, with one coordinator or so many regions."""
    given = options(
        __doc__, delay=[0.0, 1.0, 5.0, 50.0], lost=[0.0, 1.0], regions=[0, 2, 4, 8], lag=[0, 1, 3],
        every=50, agents=100, frames=Option(50, "of each turn"), turns=3,
    )  # fmt: skip
    table = Table(COLUMNS, as_json=given.json)
    settings = [NO_DELAY, *(Setting(*each) for each in product(given.delay, given.lost))]
    for regions in given.regions:
        for lag in given.lag if regions > 1 else [0]:
            with tempfile.TemporaryDirectory() as name, ExitStack() as opened:
                folder = Path(name)
                path = world(folder, given.agents, 0, regions, lag, given.every, clock=CLOCK)
                running = RunningWorld(folder, path, regions, opened, "--rate", "0")
                rates: dict[Setting, list[float]] = {each: [] for each in settings}
                for _ in range(given.turns):
                    for setting, of in rates.items():
                        of.append(running.frames_per_second(setting, given.frames))
            print_rows(table, regions, lag, rates)


if __name__ == "__main__":
    main()
