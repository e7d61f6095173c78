"""How long a world of two regions on several machines stands still when something fails.

    python -m benchmarks.region_failures [--lag 0] [--move-every 20] [--rate 20] [--json]

Coordinator and regions are hosts of their own (benchmarks/ip_lines.py, which needs root), as in
docs/howto/regions.md, with the `delay` of their lines in ms. One after the other, lines between
hosts lose everything for some seconds, region 1 is killed and started again, and the coordinator is
killed. Then a process on another host stands by, first while region 1 is killed, and again while
its host disappears. `stands still` is the longest time between two frames from the begin of a
failure on, in seconds. At the end the digest must be that of an undisturbed run; the exit code is 0
if so, otherwise 1.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from itertools import pairwise
from pathlib import Path
from typing import Final

from benchmarks.command import Option, Table, options
from benchmarks.region_lines import CLOCK, MINERVA, ROOT, RunningWorld
from benchmarks.regions import world

COLUMNS: Final = {"lag": ">4", "failure": "<44", "stands still, s": ">16.2f"}
COORDINATOR, FIRST, LAST, SPARE = range(4)
"""The hosts."""

FRAMES: Final = 20
"""That have to follow a failure."""

PATIENCE: Final = 120.0


class Failures:
    """The failures of one running world."""

    def __init__(self, running: RunningWorld) -> None:
        self._running = running
        self._last = self._former = running.processes["region-1"]

    def cut(self, hosts: tuple[int, int], seconds: float) -> None:
        """Lose everything between two hosts for some seconds."""
        cuts = self._running.lines.cuts
        cuts.add(frozenset(hosts))
        time.sleep(seconds)
        cuts.clear()

    def kill_region(self) -> None:
        """Kill region 1 and start it again at once, as a service manager does."""
        self._last.kill()
        self._last.wait()
        self._last = self._running.attach("region-1", LAST)

    def kill_coordinator(self) -> None:
        """Kill the process of the coordinator, which its launcher follows by another one."""
        launcher = self._running.coordinator.pid
        children = Path(f"/proc/{launcher}/task/{launcher}/children").read_text().split()
        os.kill(int(children[0]), signal.SIGKILL)

    def stand_by(self, host: int) -> None:
        """Let a process on a host stand by for region 1, which is killed or lost next."""
        standby = self._running.attach("region-1", host, "--standby")
        time.sleep(PATIENCE / 10)
        self._last, self._former = standby, self._last

    def kill_for_standby(self) -> None:
        """Kill region 1, while another process stands by."""
        self._former.kill()
        self._former.wait()

    def remove_host(self) -> None:
        """Lose everything from and to the spare host, where region 1 is by then, until the end."""
        lines = self._running.lines
        lines.cuts |= {frozenset((host, SPARE)) for host in (COORDINATOR, FIRST, LAST)}


def stands_still(running: RunningWorld, fail: Callable[[], None]) -> float:
    """The longest time between two frames after a failure has begun."""
    began, before = time.monotonic(), len(running.noted())
    fail()
    # Regions may have run ahead of the failure.
    running.after(max(before, len(running.noted())) + FRAMES)
    return max(
        later - max(time_, began) for time_, later in pairwise(running.noted()[before - 1 :])
    )


def digest_of(words: tuple[str, ...]) -> tuple[str, int]:
    """Digest and number of frames of an undisturbed run."""
    done = subprocess.run([*MINERVA, *words], cwd=ROOT, capture_output=True, text=True, check=True)
    summary = json.loads(done.stdout)
    return summary["digest"], summary["frames"]


def main() -> None:
    """Print a row for each failure; exits with 1 if the digest differs."""
    given = options(
        __doc__, lag=Option(0, "frames that regions run ahead"), move_every=20, rate=20.0,
        delay=Option(5.0, "of the lines, ms"), agents=100, seconds=[0.1, 1.0, 10.0],
    )  # fmt: skip
    table = Table(COLUMNS, as_json=given.json)
    with tempfile.TemporaryDirectory() as name, ExitStack() as opened:
        folder = Path(name)
        path = world(folder, given.agents, 0, 2, given.lag, given.move_every, clock=CLOCK)
        words = "--rate", str(given.rate), "--json"
        running = RunningWorld(folder, path, 2, opened, *words, spare=1)
        running.lines.delay = given.delay / 1e3
        running.after(FRAMES)
        failures = Failures(running)
        between = {"regions": (FIRST, LAST), "coordinator and region 1": (COORDINATOR, LAST)}
        failing: dict[str, Callable[[], None]] = {
            f"line between {what} cut for {seconds:g} s": lambda hosts=hosts, seconds=seconds: (
                failures.cut(hosts, seconds)
            )
            for what, hosts in between.items()
            for seconds in given.seconds
        }
        failing["region 1 killed, and started again"] = failures.kill_region
        failing["coordinator killed"] = failures.kill_coordinator
        for what, fail in failing.items():
            still = stands_still(running, fail)
            table.row({"lag": given.lag, "failure": what, "stands still, s": still})
        for host, what, fail in (
            (SPARE, "region 1 killed, another one stands by", failures.kill_for_standby),
            (LAST, "host of region 1 gone, another one stands by", failures.remove_host),
        ):
            failures.stand_by(host)
            still = stands_still(running, fail)
            table.row({"lag": given.lag, "failure": what, "stands still, s": still})
        digest, frames = running.ended()
        alone = "run", str(path), "--in-process", "--regions", "0", "--rate", "0", "--json"
        same = digest_of((*alone, "--frames", str(frames)))[0] == digest
    print(f"{frames} frames: {'the digest of' if same else 'NOT the digest of'} an undisturbed run")
    raise SystemExit(not same)


if __name__ == "__main__":
    main()
