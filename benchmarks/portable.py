"""Costs of functions with the same bits on all platforms, relative to numpy and `math`.

    python -m benchmarks.portable [--sizes N ...] [--repeat N] [--json]

Both functions of a pair alternate in this one process; compare the ratio of their minimum times, as
absolute times depend on the load of the machine. Random draws are compared with the same method on
numpy's logarithm and cosine.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial

import numpy as np

from benchmarks.command import Table, options
from minerva_bus import portable
from minerva_bus.world.context import Numbers, Rng, RngBatch

NAMES = "sin cos tan asin acos atan exp expm1 tanh log log2 log10 log1p"
PAIRS = "atan2 hypot power"
OTHERS = {"asin": "arcsin", "acos": "arccos", "atan": "arctan", "atan2": "arctan2"}
ONE_BY_ONE = 2_000
COLUMNS = {
    "function": "<18", "numbers": ">9,", "portable ns": ">12.1f", "other ns": ">9.1f",
    "ratio": ">6.2f",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Cost:
    """Cost of one function for `count` numbers; 1 means one at a time, in Python."""

    function: str
    count: int
    portable_ns: float
    other_ns: float
    ratio: float


def numpy_normal(draws: RngBatch) -> Numbers:
    """Normal numbers by the method of `RngBatch.normal` with numpy's functions."""
    radius = np.sqrt(-2.0 * np.log(1.0 - draws.random()))
    return radius * np.cos(2.0 * np.pi * draws.random())


def numpy_exponential(draws: RngBatch) -> Numbers:
    """Exponential numbers by the method of `RngBatch.exponential` with numpy's logarithm."""
    return -np.log(1.0 - draws.random())


def math_normal(draws: Rng) -> float:
    radius = math.sqrt(-2.0 * math.log(1.0 - draws.random()))
    return radius * math.cos(math.tau * draws.random())


def compared(
    name: str,
    count: int,
    each: int,
    ours: Callable[[], object],
    others: Callable[[], object],
    n: int,
) -> Cost:
    """Nanoseconds per number for both functions, the minimum of n alternating turns."""
    best = [math.inf, math.inf]
    for _ in range(n):
        for side, function in enumerate((ours, others)):
            start = time.perf_counter()
            function()
            best[side] = min(best[side], time.perf_counter() - start)
    ours_ns, others_ns = (seconds / each * 1e9 for seconds in best)
    return Cost(name, count, round(ours_ns, 1), round(others_ns, 1), round(ours_ns / others_ns, 2))


def arrays(count: int, repeat: int) -> list[Cost]:
    x, y = np.random.default_rng(1).uniform(0.01, 0.99, (2, count))
    costs = []
    for name in f"{NAMES} {PAIRS}".split():
        given = (x, y) if name in PAIRS.split() else (x,)
        ours, theirs = getattr(portable, name), getattr(np, OTHERS.get(name, name))
        costs.append(
            compared(name, count, count, partial(ours, *given), partial(theirs, *given), repeat)
        )
    draws = RngBatch(RngBatch.begin(np.arange(count, dtype=np.uint64), 1))
    for name, theirs in (("normal", numpy_normal), ("exponential", numpy_exponential)):
        ours = getattr(draws, name)
        costs.append(compared(f"chance.{name}", count, count, ours, partial(theirs, draws), repeat))
    return costs


def numbers(repeat: int) -> list[Cost]:
    costs = []
    for name in f"{NAMES} {PAIRS}".split():
        given = (0.7, 0.3) if name in PAIRS.split() else (0.7,)
        ours, theirs = getattr(portable, name), getattr(math, "pow" if name == "power" else name)

        def turn(function: Callable[..., float], given: tuple[float, ...] = given) -> None:
            for _ in range(ONE_BY_ONE):
                function(*given)

        costs.append(
            compared(name, 1, ONE_BY_ONE, partial(turn, ours), partial(turn, theirs), repeat)
        )
    draws = Rng(1)

    def drawn(function: Callable[[], float]) -> None:
        for _ in range(ONE_BY_ONE):
            function()

    costs.append(
        compared(
            "chance.normal", 1, ONE_BY_ONE, lambda: drawn(draws.normal),
            lambda: drawn(lambda: math_normal(draws)), repeat,
        )
    )  # fmt: skip
    return costs


def main() -> None:
    asked = options(__doc__, sizes=[10_000, 1_000_000], repeat=7)
    costs = numbers(asked.repeat)
    for count in asked.sizes:
        costs += arrays(count, asked.repeat)
    if asked.json:
        print(json.dumps([asdict(cost) for cost in costs]))
        return
    table = Table(COLUMNS, as_json=False)
    for cost in costs:
        table.row(asdict(cost))


if __name__ == "__main__":
    main()
