"""Simulated histories: worlds with faults, generated from seeds and checked.

    python -m checks.simulation --seed 7         run one history and print its trace
    python -m checks.simulation --seeds 1000     run histories 0 to 999
    python -m checks.simulation --minutes 30     run histories for 30 minutes, from --first on

The exit code is 1 if a history fails; the benchmark then prints its seed and the history. With
`--shorten` it removes the parts that are not needed for the failure. docs/testing.md describes the
simulation.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterator
from itertools import count

from minerva_bus.launch.console import Console
from tests.simulator.trying import Tried, report, shortest, tried_seed


def read_options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    which = parser.add_mutually_exclusive_group(required=True)
    which.add_argument("--seed", type=int, metavar="S", help="play this history, with its trace")
    which.add_argument("--seeds", type=int, metavar="N", help="play so many histories")
    which.add_argument("--minutes", type=float, metavar="M", help="play for so long")
    parser.add_argument("--first", type=int, default=0, metavar="S", help="the first seed (0)")
    parser.add_argument("--shorten", action="store_true", help="shorten a history that fails")
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    return parser.parse_args()


def seeds(options: argparse.Namespace) -> Iterator[int]:
    if options.seed is not None:
        yield options.seed
        return
    until = None if options.minutes is None else time.monotonic() + 60 * options.minutes
    for number in count():
        if number == options.seeds or (until is not None and time.monotonic() >= until):
            return
        yield options.first + number


def play_all(options: argparse.Namespace) -> tuple[Tried | None, int, int]:
    """The first failure or the last history, the number of histories, and their frames."""
    console, began = Console(quiet=options.json), time.monotonic()
    done, frames, last = 0, 0, None
    for seed in seeds(options):
        last = tried_seed(seed)
        done, frames = done + 1, frames + last.frames
        passed = time.monotonic() - began
        if options.minutes is None:
            part, whole = done, options.seeds or 1
        else:
            part, whole = round(passed), round(60 * options.minutes)
        console.progress("simulation", part, whole, f"{frames} frames, {frames / passed:.0f}/s")
        if last.wrong:
            break
    console.end()
    return last, done, frames


def main() -> int:
    options = read_options()
    began = time.monotonic()
    last, done, frames = play_all(options)
    seconds = time.monotonic() - began
    failed = last is not None and bool(last.wrong)
    seed = last.history.seed if last is not None else None
    if failed and last is not None and options.shorten:
        last = shortest(last)
    text = report(last, trace=options.seed is not None) if last is not None else ""
    if options.json:
        result = {
            "histories": done,
            "frames": frames,
            "seconds": round(seconds, 3),
            "frames_per_second": round(frames / seconds, 1) if seconds else 0.0,
            "failed_seed": seed if failed else None,
            "wrong": list(last.wrong) if last is not None else [],
            "history": text if failed else None,
        }
        print(json.dumps(result))
        return int(failed)
    if failed or options.seed is not None:
        print(text)
    pace = f"{done} histories, {frames} frames in {seconds:.1f} s ({frames / seconds:.0f} a second)"
    print(f"{pace}: {f'seed {seed} fails' if failed else 'all is well'}")
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
