"""Results of `python -m agents.benchmarks.exploration`: a row per run, in a file and as text."""

from __future__ import annotations

import json
import math
import statistics
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True, slots=True)
class Result:
    """Result of a run, in metres; `reason` is the one that the robot reported, or empty."""

    map: str
    marker: str
    held_out: bool
    noise: bool
    strategy: str
    reached: bool
    ratio: float | None
    tour: float | None
    metres: float
    shortest: float | None
    collisions: int
    frames: int
    reported: bool
    reason: str
    ms_per_frame: float
    slowest_ms: float

    @property
    def key(self) -> tuple[str, str, bool, str]:
        """Identity of the run: map, marker, noise and strategy."""
        return self.map, self.marker, self.noise, self.strategy


def read_rows(path: Path | None) -> list[Result]:
    """The rows of earlier runs, or none without the file."""
    if path is None or not path.exists():
        return []
    return [Result(**json.loads(line)) for line in path.read_text().splitlines()]


def append_row(path: Path | None, result: Result) -> None:
    """Add a row to the file; complete as soon as the run is, so an interruption loses nothing."""
    if path is not None:
        with path.open("a") as file:
            file.write(json.dumps(asdict(result)) + "\n")


def summary(results: Sequence[Result]) -> dict[str, Any]:
    """Aggregated results of some runs."""
    ratios = [result.ratio for result in results if result.reached and result.ratio is not None]
    tours = [result.tour for result in results if result.tour is not None]
    metres = math.fsum(result.metres for result in results if result.shortest)
    shortest = math.fsum(result.shortest for result in results if result.shortest)
    return {
        "runs": len(results),
        "reached": sum(result.reached for result in results),
        "mean_ratio": _mean(ratios),
        "median_ratio": round(statistics.median(ratios), 3) if ratios else None,
        "ratio_of_sums": round(metres / shortest, 3) if shortest else None,
        "worst_ratio": max(ratios, default=None),
        "mean_tour": _mean(tours),
        "collisions": sum(result.collisions for result in results),
        "lost_and_not_reported": sum(not (result.reached or result.reported) for result in results),
        "ms_per_frame": _mean([result.ms_per_frame for result in results]),
    }


def _mean(numbers: Sequence[float]) -> float | None:
    return round(statistics.fmean(numbers), 3) if numbers else None


def groups(results: Sequence[Result]) -> dict[str, dict[str, Any]]:
    """Summaries by seeds and noise, and by kind of floor."""
    members: dict[str, list[Result]] = {}
    for result in results:
        where = (
            f"{'held out' if result.held_out else 'tuned on'}{', noise' if result.noise else ''}"
        )
        members.setdefault(where, []).append(result)
    for result in results:
        members.setdefault(result.map.split("-")[0], []).append(result)
    return {name: summary(group) for name, group in members.items()}


def show(result: Result, world: dict[str, Any] | None, as_json: bool) -> None:
    """Print a row."""
    if as_json:
        print(json.dumps(asdict(result) | ({"world": world} if world else {})), flush=True)
        return
    noise = " noise" if result.noise else ""
    reported = f"  reported: {result.reason}" if result.reported else ""
    print(
        f"{result.map:16} {result.marker:8}{noise:6} {'' if result.reached else 'NOT REACHED '}"
        f"ratio {_number(result.ratio)}  tour {_number(result.tour)}"
        f"  {result.metres:7.1f} of {_number(result.shortest)} m"
        f"  {result.frames:6} frames  {result.collisions} collisions"
        f"  {result.ms_per_frame:5.1f} ms, at most {result.slowest_ms:.0f}"
        f"{reported}{f'  world: {world}' if world else ''}",
        flush=True,
    )


def _number(number: float | None) -> str:
    return "     -" if number is None else f"{number:6.2f}"
