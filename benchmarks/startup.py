"""Seconds from the start of the command to the first frame's end, beside other platforms.

    python -m benchmarks.startup [--workers 1 4 8 16] [--systems command robot minerva zenoh ...]

`command` is `minerva --help` and a shell's completion, whole processes; `robot` the robot's world
as it is shipped; `minerva` a world of K idle members. Ours count from the launcher's own start,
with Python, imports and checks. The peers' is what their scripts in --peers call `startup_s`,
which begins after their coordinator's imports, so it is the less. What is not there is left out,
saying so. Read the ratios, which come from turns taken within this one run.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from benchmarks.lockstep import PEERS, peer

MINERVA = [sys.executable, "-m", "minerva_bus.cli.main"]
STEPS = 10
IDLE = """
from minerva_bus import Generator, Primitive, Vocabulary

vocabulary = Vocabulary.of(Primitive("PNothing"))


class Idle(Generator):
    pass
"""
WORLD = """
[world]
string = "PNothing"
vocabulary = "idle:vocabulary"

[process.idle]
service = "idle:Idle"
processes = {workers}
"""

Found = float | str


def whole(words: list[str], **environment: str) -> Found:
    """How long a command takes from its start to its end."""
    began = time.perf_counter()
    done = subprocess.run(
        words, env=os.environ | environment, capture_output=True, text=True, check=False
    )
    took = time.perf_counter() - began
    return took if done.stdout else f"{words} said nothing: {done.stderr[-200:]}"


def first_frame(world: str) -> Found:
    """How long a world takes until its first frame is over, as its summary says."""
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            [*MINERVA, "run", world, "--frames", "1", "--json"],
            env=os.environ | {"MINERVA_RUNTIME_DIR": folder},
            capture_output=True, text=True, check=False,
        )  # fmt: skip
    if done.returncode:
        return f"exit code {done.returncode}: {done.stderr[-200:]}"
    return float(json.loads(done.stdout)["first_frame_seconds"])


def idle(workers: int) -> Found:
    """The start of a world of idle members."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "idle.py").write_text(IDLE)
        path = Path(folder, "world.toml")
        path.write_text(WORLD.format(workers=workers))
        return first_frame(str(path))


def started(name: str, peers: Path, workers: int) -> Found:
    """The start of one peer."""
    result = peer(name, peers, workers, STEPS)
    return result if isinstance(result, str) else result["startup_s"]


def once() -> dict[str, Callable[[], Found]]:
    """What has no number of workers."""
    asked = {"_MINERVA_COMPLETE": "complete_bash", "COMP_WORDS": "minerva r", "COMP_CWORD": "1"}
    script = str(Path(sys.executable).with_name("minerva"))
    return {
        "help": lambda: whole([*MINERVA, "--help"]),
        "completion": lambda: whole([script], **asked),
        "robot": lambda: first_frame("robot"),
    }


def measure(systems: dict[str, Callable[[], Found]], turns: int) -> dict[str, list[Found]]:
    """All systems in turns; one that cannot be measured is tried once."""
    results: dict[str, list[Found]] = {name: [] for name in systems}
    for _ in range(turns):
        for name, take in systems.items():
            if not any(isinstance(row, str) for row in results[name]):
                results[name].append(take())
    return results


def report(results: dict[str, list[Found]], workers: int | None, as_json: bool) -> None:
    """Print the medians, with ratios to ours of the same number of workers."""
    medians = {
        name: statistics.median(rows)
        for name, rows in results.items()
        if not any(isinstance(row, str) for row in rows)
    }
    for name, rows in results.items():
        if name not in medians:
            print(f"{name:10} left out: {rows[-1]}", file=sys.stderr)
            continue
        ratio = medians[name] / medians["minerva"] if "minerva" in medians else None
        row = {"system": name, "workers": workers, "seconds": medians[name], "ratio": ratio}
        if as_json:
            print(json.dumps(row))
        else:
            shown = f"{ratio:6.2f}" if ratio is not None else ""
            print(f"{name:10} {workers or '':>7} {medians[name]:8.3f} {shown}")


def main() -> None:
    """Measure in turns and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--workers", type=int, nargs="*", default=[1, 4, 8, 16])
    parser.add_argument("--turns", type=int, default=5)
    parser.add_argument("--systems", nargs="+", default=[*once(), "minerva", *PEERS])
    parser.add_argument("--peers", type=Path, default=Path("../shared/peers"))
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    chosen = arguments.systems
    if not arguments.json:
        print(f"{'system':10} {'workers':>7} {'seconds':>8} {'ratio':>6}")
    alone = {name: take for name, take in once().items() if name in chosen}
    report(measure(alone, arguments.turns), None, arguments.json)
    for workers in arguments.workers:
        systems: dict[str, Callable[[], Found]] = {}
        if "minerva" in chosen:
            systems["minerva"] = lambda k=workers: idle(k)
        for name in [name for name in PEERS if name in chosen]:
            systems[name] = lambda n=name, k=workers: started(n, arguments.peers, k)
        report(measure(systems, arguments.turns), workers, arguments.json)


if __name__ == "__main__":
    main()
