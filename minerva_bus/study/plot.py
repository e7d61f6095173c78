"""A plot of a record: `minerva plot`. Needs the extra `plot`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from minerva_bus.log.reader import Record
from minerva_bus.plotting import DOTS, FAINT, INK, draw
from minerva_bus.semantics.geometry import interpret
from minerva_bus.study.drawing import Ground, draw_tracks, halo, limits
from minerva_bus.study.palette import Palette
from minerva_bus.study.tracks import Story, story_of


def plot(record: Record, into: Path) -> None:
    """Draw a record: a map with the tracks of its agents, and statistics over time.

    The suffix names the format: png, svg or pdf. Raises MisuseError without matplotlib, and for a
    file that may not or cannot be written.
    """
    story = story_of(record)
    draw(into, (12, 6.6), lambda figure: _draw(figure, story, record))


def _draw(figure: Any, story: Story, record: Record) -> None:
    palette = Palette(story)
    panels = [_events, _frame_times]
    if any(len(set(counts)) > 1 for counts in story.counts.values()):
        panels.insert(0, _counts)
    if story.distances:
        panels.insert(0, _distances)
    left, right = figure.subfigures(1, 2, width_ratios=(2.1, 1))
    axis = left.subplots()
    _map(axis, story, palette)
    _title(axis, record, len(story.seconds))
    axes = right.subplots(len(panels), 1, squeeze=False)[:, 0]
    for axis, panel in zip(axes, panels, strict=True):
        panel(axis, story, palette)
        axis.grid(visible=True)
        axis.set_axisbelow(True)


def _title(axis: Any, record: Record, frames: int) -> None:
    world = record.description.world
    axis.set_title(world.name, fontsize=15, pad=22)
    axis.text(
        0.0,
        1.0,
        f"seed {world.seed}   ·   {frames:,} frames of {world.dt:g} s"
        + ("" if record.complete else "   ·   incomplete record"),
        transform=axis.transAxes + _points(0, 8),
        color=FAINT,
    )


def _points(x: float, y: float) -> Any:
    from matplotlib.transforms import Affine2D

    return Affine2D().translate(x * DOTS / 72, y * DOTS / 72)


def _map(axis: Any, story: Story, palette: Palette) -> None:
    interpret(story.ground, Ground(axis, story.vocabulary))
    frame = limits(story)
    draw_tracks(axis, story, palette, frame)
    axis.set_aspect("equal")
    axis.set(xlim=(frame.left, frame.right), ylim=(frame.bottom, frame.top), xlabel="x, m")
    axis.set_ylabel("y, m")
    handles = palette.handles()
    if handles:
        axis.legend(
            handles=handles,
            loc="upper center",
            bbox_to_anchor=(0.5, -0.07),
            ncols=min(6, len(handles)),
        )


def _distances(axis: Any, story: Story, palette: Palette) -> None:
    for agent, (times, metres) in story.distances.items():
        axis.plot(times, metres, color=palette.of(story.tracks[agent]), linewidth=1.6)
        axis.plot(times[-1:], metres[-1:], "o", color=palette.of(story.tracks[agent]), markersize=4)
    axis.set(title="distance to the objective, m", xlabel="time, s")
    axis.set_ylim(bottom=0)


def _counts(axis: Any, story: Story, palette: Palette) -> None:
    for kind, counts in story.counts.items():
        if len(set(counts)) > 1:
            axis.plot(story.times, counts, color=palette.of_kind(kind), linewidth=1.6)
            axis.annotate(
                kind,
                (story.times[-1], counts[-1]),
                xytext=(4, 0),
                textcoords="offset points",
                color=palette.of_kind(kind),
                va="center",
            )
    axis.set(title="agents", xlabel="time, s")
    axis.set_ylim(bottom=0)


def _events(axis: Any, story: Story, palette: Palette) -> None:
    axis.plot(story.events, color=FAINT, linewidth=0.9)
    axis.set(title="events per frame", xlabel="frame")
    axis.set_ylim(bottom=0)


def _frame_times(axis: Any, story: Story, palette: Palette) -> None:
    times = np.diff(story.seconds) * 1000
    axis.set(title="wall time per frame, ms", xlabel="frame")
    if not len(times) or not (times > 0).any():
        axis.text(0.5, 0.5, "not measured", transform=axis.transAxes, ha="center", color=FAINT)
        return
    frames = np.arange(1, len(times) + 1)
    # Rasterized, because a vector file with a mark for each of many frames is large and slow to
    # draw.
    axis.plot(frames, times, ".", color="#9fb3c1", markersize=2.5, alpha=0.6, rasterized=True)
    middle = float(np.median(times))
    axis.axhline(middle, color=INK, linewidth=1)
    axis.annotate(
        f"median {middle:.3g}",
        (1, middle),
        xycoords=("axes fraction", "data"),
        xytext=(-2, 4),
        textcoords="offset points",
        ha="right",
        path_effects=halo(),
    )
    # A single slow frame would press all others against the axis.
    axis.set_ylim(0, 1.15 * float(np.percentile(times, 99.5)))
