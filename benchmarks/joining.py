"""Milliseconds until a new host of agents serves in a running world.

    python -m benchmarks.joining [--agents 10000] [--rate 30] [--turns 5] [--json]

A world of walkers runs with one host; then a command attaches another one. `joined` is the time
from the start of the command until the member is present, `serves` until it has evolved agents in a
frame, and `left` the time from SIGTERM until other hosts have its agents.
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
from collections.abc import Callable
from pathlib import Path

from benchmarks.command import options
from minerva_bus.runtime.operator_client import Client
from minerva_bus.world.operator import MemberStatus

MINERVA = [sys.executable, "-m", "minerva_bus.cli.main"]
HOST, PATIENCE, LOOK = "newcomer", 30.0, 0.002
WORLD = """
[world]
scene = "walkers:scene"
vocabulary = "benchmarks.models.plain:vocabulary"
rate = {rate}

[process.clock]
service = "benchmarks.models.events:Clock"
count = {agents}

[process.host]
agents = "benchmarks.models.plain:Walker"
"""
MODULE = """
from benchmarks.models.plain import scene as walkers


def scene(options):
    return walkers({agents}, 7)
"""


def when(look: Callable[[], bool]) -> float:
    """Wait until a condition is true; returns the time."""
    until = time.perf_counter() + PATIENCE
    while not look():
        if time.perf_counter() > until:
            sys.exit(f"nothing after {PATIENCE:g} s")
        time.sleep(LOOK)
    return time.perf_counter()


def newcomer(asked: Client) -> MemberStatus | None:
    """The status of the new host if it is present, else None."""
    members = asked.operator.status().members
    return next(
        (member for member in members if (member.name, member.state) == (HOST, "present")), None
    )


def turn(asked: Client, endpoint: str, environment: dict[str, str]) -> dict[str, float]:
    """One host joins, serves and leaves; durations in milliseconds."""
    words = [*MINERVA, "attach", "benchmarks.models.plain:Walker", "--name", HOST]
    began = time.perf_counter()
    host = subprocess.Popen(
        [*words, "--connect", endpoint], env=environment, stderr=subprocess.DEVNULL
    )
    try:
        joined = when(lambda: newcomer(asked) is not None)
        admitted = asked.operator.status().frame
        serves = when(
            lambda: (member := newcomer(asked)) is not None and member.last_reply >= admitted
        )
        asked_at = time.perf_counter()
        host.send_signal(signal.SIGTERM)
        left = when(lambda: newcomer(asked) is None)
    finally:
        host.kill()
        host.wait()
    return {
        "joined": 1e3 * (joined - began),
        "serves": 1e3 * (serves - began),
        "left": 1e3 * (left - asked_at),
    }


def measure(agents: int, rate: float, turns: int) -> list[dict[str, float]]:
    """Durations of some turns in one running world."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "walkers.py").write_text(MODULE.format(agents=agents))
        world = Path(folder, "walkers.toml")
        world.write_text(WORLD.format(agents=agents, rate=rate))
        environment = os.environ | {"MINERVA_RUNTIME_DIR": folder, "PYTHONPATH": str(Path.cwd())}
        running = subprocess.Popen(
            [*MINERVA, "run", str(world), "--quiet"], env=environment, stdout=subprocess.DEVNULL
        )
        place = Path(folder, "walkers.json")
        try:
            when(lambda: place.is_file() and "endpoint" in place.read_text())
            endpoint = json.loads(place.read_text())["endpoint"]
            with Client(endpoint, "walkers") as asked:
                when(lambda: asked.operator.status().frame > 0)
                return [turn(asked, endpoint, environment) for _ in range(turns)]
        finally:
            running.terminate()
            running.wait()


def main() -> None:
    """Measure and print medians."""
    arguments = options(__doc__, agents=10_000, rate=30.0, turns=5)
    rows = measure(arguments.agents, arguments.rate, arguments.turns)
    medians = {name: statistics.median(row[name] for row in rows) for name in rows[0]}
    if arguments.json:
        print(json.dumps(medians))
    else:
        print("  ".join(f"{name} {value:.0f} ms" for name, value in medians.items()))


if __name__ == "__main__":
    main()
