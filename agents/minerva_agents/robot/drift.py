"""How far off the places are at which a robot takes itself to be.

The error at a scan is the distance from the place that was published, and the angle between both
headings; both ways begin at the same place. A small error of the first headings turns a whole way
about its beginning; so there is also what is left of the distances once both ways lie as well over
one another as a turn and a shift can make them: the absolute trajectory error of Sturm and others,
"A Benchmark for the Evaluation of RGB-D SLAM Systems" (IROS 2012), as a mean of distances.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import MisuseError
from minerva_bus.study.style import write_figure
from minerva_bus.world.poses import Pose

Reals: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Gone:
    """A scan: seconds, where the robot was, took itself to be, and was by its odometry alone."""

    time: float
    published: Pose
    taken: Pose
    chained: Pose | None


@dataclass(frozen=True, slots=True, eq=False)
class Errors:
    """Of one way, (n,) each: metres, degrees, and metres with both ways laid over one another."""

    metres: Reals
    degrees: Reals
    aligned: Reals

    def __str__(self) -> str:
        return (
            f"{self.metres.mean():.2f} m in the mean, {self.metres.max():.2f} m at most;"
            f" {self.degrees.mean():.1f} degrees, {self.degrees.max():.1f} at most;"
            f" laid over it {self.aligned.mean():.2f} m, {self.aligned.max():.2f} m at most"
        )


@dataclass(frozen=True, slots=True, eq=False)
class Drift:
    """Errors over time in seconds, (n,), and those of the odometry alone if all of it is known."""

    seconds: Reals
    taken: Errors
    chained: Errors | None

    @staticmethod
    def of(gone: Sequence[Gone]) -> Drift:
        """The errors of some scans, one at least."""
        published = [one.published for one in gone]
        chained = [one.chained for one in gone if one.chained is not None]
        return Drift(
            np.array([one.time - gone[0].time for one in gone]),
            errors_of([one.taken for one in gone], published),
            errors_of(chained, published) if len(chained) == len(gone) else None,
        )


def errors_of(taken: Sequence[Pose], published: Sequence[Pose]) -> Errors:
    """The errors of as many places as were published."""
    turns = [one.angle - other.angle for one, other in zip(taken, published, strict=True)]
    degrees = np.abs([math.remainder(turn, 360.0) for turn in turns])
    ours, theirs = (np.array([complex(one.x, one.y) for one in way]) for way in (taken, published))
    here, there = ours - ours.mean(), theirs - theirs.mean()
    turned = here * cmath.rect(1.0, cmath.phase(complex((here.conj() * there).sum())))
    return Errors(np.abs(ours - theirs), degrees, np.abs(turned - there))


_COLOURS: Final = {"odometry": "#c0392b", "matched": "#1f6f8b"}


def save_plot(drift: Drift, path: Path) -> None:
    """Draw the errors over time into a PNG. Raises MisuseError."""
    try:
        from matplotlib.figure import Figure  # late: of the extra plot
    except ImportError:
        raise MisuseError(
            f"{path}: plots need matplotlib; install it with: pip install 'minerva-bus[plot]'"
        ) from None
    figure: Any = Figure(figsize=(9, 4.5), dpi=130, layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    same = drift.chained is None or drift.chained.metres.tolist() == drift.taken.metres.tolist()
    ways = [("odometry", drift.chained), ("odometry" if same else "matched", drift.taken)]
    for name, errors in ways[same:]:
        if errors is not None:
            upper.plot(drift.seconds, errors.metres, color=_COLOURS[name], label=name, lw=1.3)
            lower.plot(drift.seconds, errors.degrees, color=_COLOURS[name], lw=1.3)
    upper.set_title("error against the published places", loc="left")
    upper.set_ylabel("distance, m")
    lower.set_ylabel("heading, degrees")
    lower.set_xlabel("time, s")
    for axis in (upper, lower):
        axis.set_yscale("symlog", linthresh=1.0)
        axis.set_ylim(bottom=0)
        axis.grid(visible=True, color="#e6e8eb")
        axis.spines[["top", "right"]].set_visible(False)
        axis.yaxis.set_major_formatter("{x:g}")
    upper.legend(frameon=False, loc="lower right", bbox_to_anchor=(1, 1), ncols=2)
    write_figure(figure, path)
