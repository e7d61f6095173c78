"""Resident memory of each process over the frames of a long run.

    python -m benchmarks.memory [--frames 100000] [--world meadow.toml] [--json]

The world runs on the bus at full speed, with a record if `--record` is given. The benchmark reads
the resident memory of its processes from /proc every few seconds. It prints the memory of each
process after a fifth of the frames and at the end, and the growth between them per thousand frames.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.command import Option, options
from minerva_bus.errors import BusError
from minerva_bus.runtime.operator_client import Client

ROOT = Path(__file__).parents[1]
MEADOW = ROOT / "worlds/minerva_worlds/meadow/meadow.toml"
SETTLED = 0.2
"""Fraction of the frames after which caches and pools are full."""


@dataclass(slots=True)
class Series:
    """Samples of the resident memory of one process in MB, with their frames."""

    name: str
    frames: list[int] = field(default_factory=list[int])
    megabytes: list[float] = field(default_factory=list[float])

    def settled(self, last: int) -> tuple[float, float, float]:
        """MB after a fifth of the frames and at the end, and growth in kB per thousand frames."""
        at = next((i for i, frame in enumerate(self.frames) if frame >= SETTLED * last), -1)
        first, end = self.megabytes[at], self.megabytes[-1]
        passed = max(1, self.frames[-1] - self.frames[at])
        return first, end, 1e6 * (end - first) / passed  # MB → kB, per thousand frames


def resident(pid: int) -> float:
    """Resident memory of a process in MB; 0 if it has ended."""
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()[1])
    except (OSError, IndexError):
        return 0.0
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def children(pid: int) -> list[int]:
    """Ids of the child processes of a process."""
    path = Path(f"/proc/{pid}/task/{pid}/children")
    return [int(word) for word in path.read_text(encoding="ascii").split()]


def watch(launcher: subprocess.Popen[bytes], folder: Path, every: float) -> dict[str, Series]:
    """Sample the memory of a world's processes until it ends."""
    series: dict[str, Series] = {}
    while launcher.poll() is None:
        time.sleep(every)
        try:
            (path,) = folder.glob("*.json")
            state = json.loads(path.read_text(encoding="utf-8"))
            with Client(state["endpoint"], state["world"]) as asked:
                status = asked.operator.status()
            members = {member.pid: member.name for member in status.members}
            started = children(launcher.pid)
        except (BusError, OSError, ValueError, KeyError):
            continue
        names = {pid: members.get(pid, "coordinator") for pid in started}
        for pid, name in {launcher.pid: "launcher", **names}.items():
            megabytes = resident(pid)
            if megabytes:
                entry = series.setdefault(name, Series(name))
                entry.frames.append(status.frame)
                entry.megabytes.append(megabytes)
    return series


def main() -> None:
    """Run the world, sample its memory, and print it."""
    every = Option(3.0, "seconds between two measurements")
    arguments = options(__doc__, frames=100_000, world=str(MEADOW), every=every, record=False)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        words = ["run", arguments.world, "--rate", "0", "--frames", str(arguments.frames)]
        words += ["--quiet"] + (["--record", str(folder / "r.mcap")] if arguments.record else [])
        began = time.monotonic()
        launcher = subprocess.Popen(
            [sys.executable, "-m", "minerva_bus.cli.main", *words],
            env={**os.environ, "MINERVA_RUNTIME_DIR": name},
            stdout=subprocess.DEVNULL,
        )
        series = watch(launcher, folder, arguments.every)
        seconds = time.monotonic() - began
    if launcher.returncode or not series:
        sys.exit(f"the world has ended with exit code {launcher.returncode}")
    report(sorted(series.values(), key=lambda entry: -entry.megabytes[-1]), arguments, seconds)


def report(series: list[Series], arguments: argparse.Namespace, seconds: float) -> None:
    """Print the results."""
    last = max(entry.frames[-1] for entry in series)
    for entry in series:
        first, end, growth = entry.settled(last)
        if arguments.json:
            row = {"process": entry.name, "first": first, "end": end, "growth": growth}
            print(json.dumps(row | {"frames": entry.frames, "megabytes": entry.megabytes}))
        else:
            print(f"{entry.name:12} {first:7.1f} MB {end:7.1f} MB {growth:7.1f} kB/1,000 frames")
    print(f"{last:,} frames in {seconds:.0f} s", file=sys.stderr)


if __name__ == "__main__":
    main()
