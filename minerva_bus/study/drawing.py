"""The map of a plot: static figures, and the tracks of agents over them."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from minerva_bus.grammar.forms import Disc, Label, Line, Raster, Shape
from minerva_bus.grammar.scene import FigureNode
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.log.showing import painted
from minerva_bus.semantics.bounds import Bounds, bounds
from minerva_bus.semantics.plane import PlaneGeometry, raster_corner, resolve
from minerva_bus.study.palette import Palette
from minerva_bus.study.tracks import Story, Track

MARGIN: Final = 0.03
MAX_SEGMENTS: Final = 60_000
"""Segments of all thin tracks together: of many agents, only the last part is drawn."""


class Ground(PlaneGeometry):
    """A geometry that draws figures on axes of matplotlib."""

    def __init__(self, axis: Any, vocabulary: Vocabulary) -> None:
        super().__init__(vocabulary)
        self._axis = axis

    def shape(self, shape: Shape, figure: FigureNode) -> None:
        if isinstance(shape, Raster):
            self._raster(shape, figure)
        elif isinstance(shape, Disc):
            self._disc(shape, figure)
        elif isinstance(shape, Line):
            self._line(shape, figure)
        else:
            self._label(shape, figure)

    def _raster(self, raster: Raster, figure: FigureNode) -> None:
        from matplotlib.transforms import Affine2D

        cells = figure.parameters[raster.cells]
        cell, corner = (
            resolve(raster.cell, figure.parameters),
            raster_corner(raster, figure.parameters, self.pose),
        )
        turned = Affine2D().rotate_deg(corner.angle).translate(corner.x, corner.y)
        self._axis.imshow(
            painted(raster, cells).swapaxes(0, 1),
            origin="lower",
            extent=(0, cells.shape[0] * cell, 0, cells.shape[1] * cell),
            transform=turned + self._axis.transData,
            interpolation="nearest",
        )

    def _disc(self, disc: Disc, figure: FigureNode) -> None:
        from matplotlib.patches import Circle

        radius = resolve(disc.radius, figure.parameters)
        circle = Circle((self.pose.x, self.pose.y), radius, color=disc.color, linewidth=0)
        self._axis.add_patch(circle)

    def _line(self, line: Line, figure: FigureNode) -> None:
        xs, ys = figure.parameters[line.xs], figure.parameters[line.ys]
        points = [self.pose.point(x, y) for x, y in zip(xs, ys, strict=False)]
        style = "--" if line.dashed else "-"
        xs, ys = [x for x, _ in points], [y for _, y in points]
        self._axis.plot(xs, ys, style, color=line.color, linewidth=1)

    def _label(self, label: Label, figure: FigureNode) -> None:
        self._axis.plot(self.pose.x, self.pose.y, "v", color=label.color, markersize=6, zorder=6)
        self._axis.annotate(
            str(figure.parameters[label.text]),
            (self.pose.x, self.pose.y),
            xytext=(0, 6),
            textcoords="offset points",
            ha="center",
            color=label.color,
            weight="bold",
            zorder=7,
            path_effects=halo(),
        )


def limits(story: Story) -> Bounds:
    """The area of the map: the ground and all tracks, with a margin."""
    area = bounds(story.ground, story.vocabulary)
    for track in story.tracks.values():
        own = Bounds(min(track.x), min(track.y), max(track.x), max(track.y))
        area = own if area is None else area.around(own)
    area = area or Bounds(0.0, 0.0, 1.0, 1.0)
    margin = MARGIN * max(area.right - area.left, area.top - area.bottom) or 1.0
    return Bounds(area.left - margin, area.bottom - margin, area.right + margin, area.top + margin)


def draw_tracks(axis: Any, story: Story, palette: Palette, frame: Bounds) -> None:
    """Draw the tracks of agents, fading towards the past, and their final places."""
    # Kinds with many agents come first, so that they do not cover the few of other kinds.
    tracks = sorted(story.tracks.values(), key=palette.size, reverse=True)
    last = MAX_SEGMENTS // max(1, len(tracks))
    for track in tracks:
        color, broad = palette.of(track), palette.broad(track)
        if track.moves:
            _path(axis, track, color, broad, len(track.x) if broad else last, frame)
        if not story.is_there(track):
            axis.plot(track.x[-1], track.y[-1], "x", color=color, markersize=5, zorder=4, alpha=0.8)
        else:
            _end(axis, track, color, broad)
    for agent, (x, y) in story.goals.items():
        color = palette.of(story.tracks[agent])
        axis.plot(x, y, "o", mfc="none", mec=color, mew=1.6, markersize=17, zorder=6)


def _path(axis: Any, track: Track, color: str, broad: bool, last: int, frame: Bounds) -> None:
    from matplotlib.collections import LineCollection
    from matplotlib.colors import to_rgb

    # One more point than segments.
    points = np.column_stack((track.x, track.y))[-last - 1 :]
    pieces = np.stack((points[:-1], points[1:]), axis=1)
    span = 0.5 * np.array([frame.right - frame.left, frame.top - frame.bottom])
    # An agent of a torus crosses its edge; a line across the whole map would mean nothing.
    near = (np.abs(pieces[:, 1] - pieces[:, 0]) < span).all(axis=1)
    strength = np.linspace(0.35 if broad else 0.0, 1.0, len(pieces))[:, None]
    shades = np.ones((len(pieces), 4))
    if broad:  # Where transparent pieces overlap, their ends would be visible.
        shades[:, :3] = 1 + strength * (np.array(to_rgb(color)) - 1)
    else:
        shades[:, :3], shades[:, 3:] = to_rgb(color), 0.5 * strength
    lines = LineCollection(
        list(pieces[near]),
        colors=shades[near],
        linewidths=2.0 if broad else 0.8,
        capstyle="round" if broad else "butt",
        zorder=3,
    )
    axis.add_collection(lines, autolim=False)


def _end(axis: Any, track: Track, color: str, broad: bool) -> None:
    x, y = track.x[-1], track.y[-1]
    size = 9 if broad and track.moves else 5
    marker = (3, 0, track.angle - 90) if track.moves else "o"
    axis.plot(x, y, marker=marker, color=color, markersize=size, mec="white", mew=0.7, zorder=5)
    if broad and track.moves:
        begin = track.x[0], track.y[0]
        axis.plot(*begin, "o", mfc="white", mec=color, mew=1.8, markersize=7, zorder=8)


def halo() -> list[Any]:
    """An outline that makes text readable on any background."""
    from matplotlib import patheffects

    return [patheffects.withStroke(linewidth=2.5, foreground="white")]
