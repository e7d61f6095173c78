"""A plot of a record: a map with the tracks of its agents, and statistics over time."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any, Final

import numpy as np

from minerva_analysis.places import painted
from minerva_analysis.plotting import COLORS, DOTS, FAINT, INK, draw, label_ends, show_grid
from minerva_analysis.tracks import Story, Track, story_of
from minerva_bus.grammar.appearance import Disc, Label, Line, Raster, Shape
from minerva_bus.grammar.scene import FigureNode
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.log.record import Record
from minerva_bus.semantics.geometry import interpret
from minerva_bus.semantics.plane import Bounds, PlaneGeometry, bounds, raster_corner, resolve
from minerva_services.geometry.colors import color_of

MARGIN: Final = 0.03
MAX_SEGMENTS: Final = 60_000
"""Segments of all thin tracks together: of many agents, only the last part is drawn."""

MAX_OWN: Final = 4
"""Number of moving agents up to which each has its own colour."""

MAX_BROAD: Final = 8
"""Number of agents of a kind up to which they have broad tracks."""


def plot(record: Record, into: Path) -> None:
    """Draw a record: a map with the tracks of its agents, and statistics over time.

    The suffix names the format: png, svg or pdf. Raises MisuseError without matplotlib, and for a
    file that may not or cannot be written.
    """
    story = story_of(record)
    draw(into, (12, 6.6), lambda figure: _draw(figure, story, record))


def _draw(figure: Any, story: Story, record: Record) -> None:
    palette = _Palette(story)
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
        show_grid(axis)


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


def _map(axis: Any, story: Story, palette: _Palette) -> None:
    interpret(story.ground, _Ground(axis, story.vocabulary))
    frame = _limits(story)
    _draw_tracks(axis, story, palette, frame)
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


def _distances(axis: Any, story: Story, palette: _Palette) -> None:
    for agent, (times, metres) in story.distances.items():
        axis.plot(times, metres, color=palette.of(story.tracks[agent]), linewidth=1.6)
        axis.plot(times[-1:], metres[-1:], "o", color=palette.of(story.tracks[agent]), markersize=4)
    axis.set(title="distance to the objective, m", xlabel="time, s")
    axis.set_ylim(bottom=0)


def _counts(axis: Any, story: Story, palette: _Palette) -> None:
    changing = {kind: counts for kind, counts in story.counts.items() if len(set(counts)) > 1}
    for kind, counts in changing.items():
        axis.plot(story.times, counts, color=palette.of_kind(kind), linewidth=1.6)
    axis.set(title="agents", xlabel="time, s")
    axis.set_ylim(bottom=0)
    label_ends(
        axis,
        [(counts[-1], kind, palette.of_kind(kind)) for kind, counts in changing.items()],
    )


def _events(axis: Any, story: Story, palette: _Palette) -> None:
    axis.plot(story.events, color=FAINT, linewidth=0.9)
    axis.set(title="events per frame", xlabel="frame")
    axis.set_ylim(bottom=0)


def _frame_times(axis: Any, story: Story, palette: _Palette) -> None:
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
        path_effects=_halo(),
    )
    # A single slow frame would press all others against the axis.
    axis.set_ylim(0, 1.15 * float(np.percentile(times, 99.5)))


class _Ground(PlaneGeometry):
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
        color = color_of(disc.color, figure.parameters)
        circle = Circle((self.pose.x, self.pose.y), radius, color=color, linewidth=0)
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
            path_effects=_halo(),
        )


def _limits(story: Story) -> Bounds:
    """The area of the map: the ground and all tracks, with a margin."""
    area = bounds(story.ground, story.vocabulary)
    for track in story.tracks.values():
        own = Bounds(min(track.x), min(track.y), max(track.x), max(track.y))
        area = own if area is None else area.around(own)
    area = area or Bounds(0.0, 0.0, 1.0, 1.0)
    margin = MARGIN * max(area.right - area.left, area.top - area.bottom) or 1.0
    return Bounds(area.left - margin, area.bottom - margin, area.right + margin, area.top + margin)


def _draw_tracks(axis: Any, story: Story, palette: _Palette, frame: Bounds) -> None:
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


def _halo() -> list[Any]:
    """An outline that makes text readable on any background."""
    from matplotlib import patheffects

    return [patheffects.withStroke(linewidth=2.5, foreground="white")]


class _Palette:
    """The colours of agents and kinds in one plot."""

    def __init__(self, story: Story) -> None:
        tracks = list(story.tracks.values())
        movers = [track for track in tracks if track.moves]
        own = [track.agent for track in movers] if len(movers) <= MAX_OWN else []
        self._own = frozenset(own)
        self._moving = frozenset(map(self._name, movers))
        self._sizes = Counter(track.kind for track in tracks)
        # Moving agents come first: the colours repeat, and those with tracks need different ones
        # most.
        names = [self._name(track) for track in movers]
        names += [self._name(track) for track in tracks]
        names += story.counts
        ordered = dict.fromkeys(names)
        self._colors = {name: COLORS[n % len(COLORS)] for n, name in enumerate(ordered)}
        self._shown = tuple(dict.fromkeys(map(self._name, [*movers, *tracks])))
        self._gone = any(not story.is_there(track) for track in tracks)

    def _name(self, track: Track) -> str:
        return track.agent if track.agent in self._own else track.kind

    def of(self, track: Track) -> str:
        """The colour of an agent."""
        return self._colors[self._name(track)]

    def of_kind(self, kind: str) -> str:
        """The colour of a kind."""
        return self._colors[kind]

    def broad(self, track: Track) -> bool:
        """Whether an agent has a broad track: there are few of its kind."""
        return self._sizes[track.kind] <= MAX_BROAD

    def size(self, track: Track) -> int:
        """The number of agents of its kind."""
        return self._sizes[track.kind]

    def handles(self) -> list[Any]:
        """The entries of the legend."""
        from matplotlib.lines import Line2D

        handles = [
            Line2D(
                [],
                [],
                color=self._colors[name],
                marker="o",
                markersize=5,
                label=name,
                linestyle="-" if name in self._moving else "",
            )
            for name in self._shown
        ]
        if self._gone:
            handles.append(Line2D([], [], color=FAINT, marker="x", linestyle="", label="gone"))
        return handles
