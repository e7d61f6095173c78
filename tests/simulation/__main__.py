"""Simulated histories: worlds with faults, generated from seeds and checked.

    python -m tests.simulation --seed 7                  run one history and print its trace
    python -m tests.simulation --histories 1000          run histories 0 to 999
    python -m tests.simulation --histories 1000000 --jobs 2 --results build/histories.json
    python -m tests.simulation --minutes 30              run histories for 30 minutes
    python -m tests.simulation --today 100               run 100 histories of this day and revision

The exit code is 1 if a history fails, 130 if it is interrupted. With `--results`, the file holds
what has been played, and the same command goes on from there if neither the project nor the
simulator has changed. docs/testing.md describes the simulation.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import json
import multiprocessing
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import asdict, replace
from datetime import UTC, datetime
from itertools import count
from pathlib import Path
from threading import Event
from typing import Final

from minerva_bus.files import replacing
from minerva_bus.launch.console import Console
from tests.simulator.batches import Results, played
from tests.simulator.trying import Tried, report, shortest, tried, tried_seed
from tests.simulator.writing import read_back

ROOT: Final = Path(__file__).resolve().parents[2]
INTERRUPTED: Final = 130
BATCH: Final = 5
"""Histories between two writes of the results."""
MOST_FAILURES: Final = 10
"""Failures after which no further history is played."""


def read_options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m tests.simulation",
        description=__doc__,
        formatter_class=argparse.RawTextHelpFormatter,
    )
    which = parser.add_mutually_exclusive_group(required=True)
    which.add_argument("--seed", type=int, metavar="S", help="play this history, with its trace")
    which.add_argument("--histories", type=int, metavar="N", help="play so many histories")
    which.add_argument("--minutes", type=float, metavar="M", help="play for so long")
    which.add_argument(
        "--today", type=int, metavar="N", help="play so many; the first seed is drawn for the day"
    )
    parser.add_argument("--first", type=int, default=0, metavar="S", help="the first seed (0)")
    parser.add_argument("--jobs", type=int, default=1, metavar="J", help="processes (1)")
    parser.add_argument("--results", type=Path, metavar="FILE", help="keep the results, and go on")
    parser.add_argument("--shorten", action="store_true", help="shorten a history that fails")
    parser.add_argument("--json", action="store_true", help="print the results as JSON")
    given = parser.parse_args()
    if given.jobs < 1 or not all(number is None or number > 0 for number in (
        given.histories, given.minutes, given.today
    )):  # fmt: skip
        parser.error("numbers of histories, minutes and jobs must be positive")
    return given


def code_of() -> str:
    """A checksum of the code that decides what a history does."""
    whole = hashlib.sha256()
    for folder in ("minerva_bus", "tests/simulator"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            whole.update(f"{path.relative_to(ROOT)}\n".encode() + path.read_bytes())
    return whole.hexdigest()[:16]


def revision_of() -> str:
    """The revision of git, or "unknown" without it."""
    with contextlib.suppress(OSError, subprocess.CalledProcessError):
        words = ["git", "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*"]
        done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=True)
        return done.stdout.strip()
    return "unknown"


def first_of(day: str, revision: str) -> int:
    """The first seed of a day for a revision."""
    return int.from_bytes(hashlib.sha256(f"{day} {revision}".encode()).digest()[:4])


def batches(first: int, histories: int | None, until: float, interrupted: Event) -> Iterator[range]:
    """Seeds in batches, until so many are played, the monotonic clock says so, or a person does."""
    end = sys.maxsize if histories is None else first + histories
    for start in count(first, BATCH):
        if start >= end or time.monotonic() >= until or interrupted.is_set():
            return
        yield range(start, min(start + BATCH, end))


def each_played(ranges: Iterable[range], jobs: int) -> Iterator[Results]:
    """The results of batches, in their order, by so many processes."""
    if jobs == 1:
        yield from map(played, ranges)
        return
    # Forked before there are threads, so that the handler of interruptions holds in all of them.
    with ProcessPoolExecutor(jobs, multiprocessing.get_context("fork")) as pool:
        waiting: deque[Future[Results]] = deque()
        for each in ranges:
            waiting.append(pool.submit(played, each))
            if len(waiting) == 2 * jobs:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()


def kept(path: Path | None, begun: Results) -> Results:
    """The results in a file if they are of the same code and the same first seed."""
    if path is None or not path.exists():
        return begun
    try:
        plain = json.loads(path.read_text(encoding="utf-8"))
        plain.pop("rate")
        earlier = Results(**plain)
    except (OSError, ValueError, TypeError, KeyError) as error:
        sys.exit(f"{path}: not the results of histories ({error}); choose another file")
    same = (earlier.code, earlier.first) == (begun.code, begun.first)
    return earlier if same else begun


def keep(path: Path | None, results: Results) -> None:
    """Write the results as a whole: an interruption leaves the last ones."""
    if path is not None:
        plain = asdict(results) | {"rate": round(results.rate, 2)}
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as file:
            file.write(f"{json.dumps(plain, indent=1)}\n".encode())


def play_all(options: argparse.Namespace, results: Results) -> tuple[Results, bool]:
    """The results with those of the histories that the options ask for, and whether all ended."""
    console, began = Console(quiet=options.json), time.monotonic()
    until = began + 60 * options.minutes if options.minutes else float("inf")
    histories: int | None = options.histories or options.today
    remaining = None if histories is None else max(0, histories - results.histories)
    earlier, interrupted = results.histories, Event()
    signal.signal(signal.SIGINT, lambda *_: interrupted.set())
    ranges = batches(results.first + results.histories, remaining, until, interrupted)
    for batch in each_played(ranges, options.jobs):
        results = results.with_batch(batch)
        keep(options.results, results)
        seconds = time.monotonic() - began
        per_second = (results.histories - earlier) / seconds
        share = (results.histories, histories or 0)
        if histories is None:
            share = round(seconds), round(60 * options.minutes)
        rest = f"{per_second:.1f} histories/s, {results.rate:.1f} per CPU second"
        console.progress("simulation", *share, rest)
        if len(results.failures) >= MOST_FAILURES:
            break
    console.end()
    return results, not interrupted.is_set()


def show_seed(seed: int, shorten: bool) -> int:
    """Play one history and print it with its trace."""
    again = tried_seed(seed)
    again = shortest(again) if again.wrong and shorten else again
    print(report(again, trace=True))
    print(f"{again.frames} frames: {f'seed {seed} fails' if again.wrong else 'all is well'}")
    return int(bool(again.wrong))


def _failed(line: str, shorten: bool) -> Tried:
    again = tried(read_back(line)[0])
    return shortest(again) if again.wrong and shorten else again


def main() -> int:
    options = read_options()
    if options.seed is not None:
        return show_seed(options.seed, options.shorten)
    begun = Results(revision_of(), code_of(), options.first)
    if options.today:
        day = datetime.now(UTC).date().isoformat()
        begun = replace(begun, first=first_of(day, begun.revision))
        if not options.json:
            print(f"{day}, revision {begun.revision}: histories from seed {begun.first} on")
    results, ended = play_all(options, kept(options.results, begun))
    if options.json:
        print(json.dumps(asdict(results) | {"rate": round(results.rate, 2)}))
    else:
        for line in results.failures:
            print(report(_failed(line, options.shorten)))
        print(f"{results}: {len(results.failures) or 'none'} failed")
    if not ended:
        return INTERRUPTED
    return int(bool(results.failures))


if __name__ == "__main__":
    sys.exit(main())
