"""Seconds from the start of a command to the end of the first frame, with other platforms.

    python -m benchmarks.startup [--workers 1 4 8 16] [--systems command robot minerva zenoh ...]

`command` measures complete processes of `minerva --help` and of shell completion, `robot` the
shipped world of the robot, and `minerva` a world of K idle members. These times begin at the start
of the launcher and include Python, imports and checks. A peer's time is `startup_s` of its script
in --peers, which begins after its coordinator's imports and is therefore shorter. Missing peers are
skipped with a message. Compare the ratios, which are from alternating turns in one run.
"""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from benchmarks.command import ENVIRONMENT, PEERS_FOLDER, Table, options
from benchmarks.lockstep import PEERS, peer

MINERVA = [sys.executable, "-m", "minerva_bus.cli.main"]
STEPS = 10
COLUMNS = {"system": "<10", "workers": ">7", "seconds": ">8.3f", "ratio": ">6.2f"}
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
    """Duration of a command from its start to its end."""
    began = time.perf_counter()
    done = subprocess.run(
        words, env=ENVIRONMENT | environment, capture_output=True, text=True, check=False
    )
    took = time.perf_counter() - began
    return took if done.stdout else f"{words} said nothing: {done.stderr[-200:]}"


def first_frame(world: str) -> Found:
    """Time until a world completes its first frame, from its summary."""
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            [*MINERVA, "run", world, "--frames", "1", "--json"],
            env=ENVIRONMENT | {"MINERVA_RUNTIME_DIR": folder},
            capture_output=True, text=True, check=False,
        )  # fmt: skip
    if done.returncode:
        return f"exit code {done.returncode}: {done.stderr[-200:]}"
    return float(json.loads(done.stdout)["first_frame_seconds"])


def idle(workers: int) -> Found:
    """Start time of a world of idle members."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "idle.py").write_text(IDLE)
        path = Path(folder, "world.toml")
        path.write_text(WORLD.format(workers=workers))
        return first_frame(str(path))


def started(name: str, peers: Path, workers: int) -> Found:
    """Start time of one peer."""
    result = peer(name, peers, workers, STEPS)
    return result if isinstance(result, str) else result["startup_s"]


def once() -> dict[str, Callable[[], Found]]:
    """Systems without a number of workers."""
    asked = {"_MINERVA_COMPLETE": "complete_bash", "COMP_WORDS": "minerva r", "COMP_CWORD": "1"}
    script = str(Path(sys.executable).with_name("minerva"))
    return {
        "help": lambda: whole([*MINERVA, "--help"]),
        "completion": lambda: whole([script], **asked),
        "robot": lambda: first_frame("robot"),
    }


def measure(systems: dict[str, Callable[[], Found]], turns: int) -> dict[str, list[Found]]:
    """Measure all systems in turns; one that fails is not tried again."""
    results: dict[str, list[Found]] = {name: [] for name in systems}
    for _ in range(turns):
        for name, take in systems.items():
            if not any(isinstance(row, str) for row in results[name]):
                results[name].append(take())
    return results


def report(results: dict[str, list[Found]], workers: int | None, table: Table) -> None:
    """Print the medians, with ratios to Minerva Bus for the same number of workers."""
    medians = {
        name: statistics.median(numbers)
        for name, rows in results.items()
        if len(numbers := [row for row in rows if not isinstance(row, str)]) == len(rows)
    }
    for name, rows in results.items():
        if name not in medians:
            print(f"{name:10} left out: {rows[-1]}", file=sys.stderr)
            continue
        ratio = medians[name] / medians["minerva"] if "minerva" in medians else None
        row = {"system": name, "workers": workers, "seconds": medians[name], "ratio": ratio}
        table.row(row)


def main() -> None:
    """Measure in turns and print a table."""
    arguments = options(
        __doc__,
        workers=[1, 4, 8, 16],
        turns=5,
        systems=[*once(), "minerva", *PEERS],
        peers=PEERS_FOLDER,
    )
    chosen = arguments.systems
    table = Table(COLUMNS, as_json=arguments.json)
    alone = {name: take for name, take in once().items() if name in chosen}
    report(measure(alone, arguments.turns), None, table)
    for workers in arguments.workers:
        systems: dict[str, Callable[[], Found]] = {}
        if "minerva" in chosen:
            systems["minerva"] = lambda k=workers: idle(k)
        for name in [name for name in PEERS if name in chosen]:
            systems[name] = lambda n=name, k=workers: started(n, arguments.peers, k)
        report(measure(systems, arguments.turns), workers, table)


if __name__ == "__main__":
    main()
