"""Trajectory errors: how far the estimated poses are from the published ones.

The error at a scan is the distance to the published position and the difference of headings; both
trajectories start at the same pose. Because a small initial heading error rotates a whole
trajectory, the error after optimal alignment by rotation and translation is reported too: the
absolute trajectory error of Sturm et al., "A Benchmark for the Evaluation of RGB-D SLAM Systems"
(IROS 2012), as a mean distance.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from minerva_agents.robot.motion import Reals
from minerva_bus.errors import MisuseError
from minerva_bus.plotting import write_figure
from minerva_bus.semantics.poses import Pose
from minerva_bus.wording import install
from minerva_bus.world.clock_steps import seconds_of


@dataclass(frozen=True, slots=True)
class TrajectoryPoint:
    """Poses of a scan at `time` seconds: published, estimated, and by odometry alone."""

    time: float
    published: Pose
    taken: Pose
    chained: Pose | None


@dataclass(frozen=True, slots=True, eq=False)
class Errors:
    """Errors along a trajectory, (n,) each: metres, degrees, and metres after alignment."""

    metres: Reals
    degrees: Reals
    aligned: Reals

    def __str__(self) -> str:
        return (
            f"mean {self.metres.mean():.2f} m, maximum {self.metres.max():.2f} m;"
            f" heading {self.degrees.mean():.1f} degrees, maximum {self.degrees.max():.1f};"
            f" aligned {self.aligned.mean():.2f} m, maximum {self.aligned.max():.2f} m"
        )


@dataclass(frozen=True, slots=True, eq=False)
class Drift:
    """Errors over time in seconds, (n,), and those of pure odometry where it is complete."""

    seconds: Reals
    taken: Errors
    chained: Errors | None

    @staticmethod
    def of(points: Sequence[TrajectoryPoint]) -> Drift:
        """Errors of a trajectory of at least one point."""
        published = [point.published for point in points]
        chained = [point.chained for point in points if point.chained is not None]
        return Drift(
            np.array(seconds_of([point.time for point in points])),
            errors_of([point.taken for point in points], published),
            errors_of(chained, published) if len(chained) == len(points) else None,
        )


def errors_of(taken: Sequence[Pose], published: Sequence[Pose]) -> Errors:
    """Errors of estimated poses against as many published ones."""
    turns = [estimate.angle - pose.angle for estimate, pose in zip(taken, published, strict=True)]
    degrees = np.abs([math.remainder(turn, 360.0) for turn in turns])
    ours, theirs = (
        np.array([complex(pose.x, pose.y) for pose in way]) for way in (taken, published)
    )
    here, there = ours - ours.mean(), theirs - theirs.mean()
    # As complex numbers, the phase of the correlation is the rotation of least squared error.
    turned = here * cmath.rect(1.0, cmath.phase(complex((here.conj() * there).sum())))
    return Errors(np.abs(ours - theirs), degrees, np.abs(turned - there))


_COLOURS: Final = {"odometry": "#c0392b", "matched": "#1f6f8b"}


def save_plot(drift: Drift, path: Path) -> None:
    """Plot the errors over time as PNG. Raises MisuseError."""
    try:
        from matplotlib.figure import Figure  # late: optional dependency (extra "plot")
    except ImportError:
        raise MisuseError(
            f"{path}: plots need matplotlib; install it with: {install('plot')}"
        ) from None
    figure: Any = Figure(figsize=(9, 4.5), dpi=130, layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    same = drift.chained is None or drift.chained.metres.tolist() == drift.taken.metres.tolist()
    ways = [("odometry", drift.chained), ("odometry" if same else "matched", drift.taken)]
    for name, errors in ways[same:]:
        if errors is not None:
            upper.plot(drift.seconds, errors.metres, color=_COLOURS[name], label=name, lw=1.3)
            lower.plot(drift.seconds, errors.degrees, color=_COLOURS[name], lw=1.3)
    upper.set_title("error relative to the published poses", loc="left")
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
