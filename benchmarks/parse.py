"""Seconds to parse, check, print and digest texts of growing size.

    python -m benchmarks.parse [--sizes 0.01 0.1 1] [--json]

The text is that of a crowd: a moved figure and an agent with its state, repeated with numbers that
rarely recur. Each time is the minimum of three runs.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from typing import Any

from benchmarks.command import options
from minerva_bus import Agent, Metres, Motion, Primitive, Scene, Transformation, Vocabulary, parse

PFox = Primitive("PFox")
TMove = Transformation("TMove", Motion(x="x", y="y"), x=Metres, y=Metres)


class Fox(Agent, symbol="AFox"):
    """An agent with a typical amount of state."""

    x: Metres = 0.0
    y: Metres = 0.0
    energy: float = 0.0
    name: str = ""


VOCABULARY = Vocabulary.of(PFox, TMove, Fox)


def crowd(megabytes: float) -> str:
    """A text of about `megabytes` MB."""
    parts: list[str] = []
    size = 0
    while size < megabytes * 1e6:
        n = len(parts)
        place = f"x={n * 0.37:.2f}, y={n}"
        parts.append(f'TMove<{place}>(PFox) · AFox#f{n}<{place}, energy={n % 7}, name="fox {n}">()')
        size += len(parts[-1].encode()) + 4
    return " · ".join(parts)


def least(action: Callable[[], Any], times: int = 3) -> float:
    """Minimum duration of an action in seconds."""
    seconds: list[float] = []
    for _ in range(times):
        began = time.perf_counter()
        action()
        seconds.append(time.perf_counter() - began)
    return min(seconds)


def measure(megabytes: float) -> dict[str, float]:
    """Durations for one size in seconds."""
    text = crowd(megabytes)
    w = VOCABULARY.read(text)
    return {
        "megabytes": len(text.encode()) / 1e6,
        "parse": least(lambda: parse(text)),
        "read": least(lambda: VOCABULARY.read(text)),
        "check": least(lambda: VOCABULARY.check(w)),
        "print": least(lambda: str(w)),
        "digest": least(lambda: parse(text).digest) - least(lambda: parse(text)),
        "digest again": least(lambda: Scene(w.nodes).digest),
    }


def table(rows: list[dict[str, float]]) -> str:
    """The measurements as text; `MB/s` is the rate of parsing."""
    columns = [name for name in rows[0] if name != "megabytes"]
    lines = ["".join(f"{name:>14}" for name in ("megabytes", "MB/s", *columns))]
    for row in rows:
        speed = row["megabytes"] / row["parse"]
        cells = [f"{row['megabytes']:14.3f}{speed:14.2f}", *[f"{row[c]:13.4f}s" for c in columns]]
        lines.append("".join(cells))
    return "\n".join(lines)


def main() -> None:
    """Measure and print."""
    chosen = options(__doc__, sizes=[0.01, 0.1, 1.0])
    rows = [measure(size) for size in chosen.sizes]
    print(json.dumps(rows) if chosen.json else table(rows))


if __name__ == "__main__":
    main()
