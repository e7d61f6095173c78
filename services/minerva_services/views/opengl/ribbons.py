"""Lines as flat ribbons, and laser beams."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import moderngl
import numpy as np
from numpy.typing import NDArray

from minerva_bus.grammar.appearance import Line
from minerva_services.geometry.colors import rgb
from minerva_services.geometry.picture import Discs, Picture, Polyline
from minerva_services.views.opengl import shaders
from minerva_services.views.opengl.gpu import GrowingBuffer, program
from minerva_services.views.window.painter import Beams
from minerva_services.views.window.picking import Spot

Single = NDArray[np.float32]

# Height of beams, and half the diagonal of the mark at a hit (_DOT), in metres.
_BEAM_LEVEL = 0.2
_FAN, _END = (0.86, 0.20, 0.16, 0.13), (0.80, 0.12, 0.10, 0.9)
_DOT = 0.035
_SELECTION_COLOR = "#1f6fd1"


@dataclass(frozen=True, slots=True, eq=False)
class RaisedLine:
    """A line at a height (m)."""

    line: Polyline
    level: float


def raised_lines(picture: Picture, level: float) -> list[RaisedLine]:
    """The lines of a picture: on the floor, or on top of an agent's disc if they are its detail.

    A line is a detail if all of it is near a preceding disc of the same owner.
    """
    lines: list[RaisedLine] = []
    before: list[Discs] = []
    for item in picture.items:
        if isinstance(item, Discs):
            before.append(item)
        elif isinstance(item, Polyline) and len(item.points) > 1:
            lines.append(RaisedLine(item, _top(item, before[-1:]) or level))
    return lines


def ring(spot: Spot, level: float) -> RaisedLine:
    """A ring around a selected disc."""
    turn = np.linspace(0, 2 * np.pi, 49)
    around = np.stack([np.cos(turn), np.sin(turn)], axis=1) * 1.5 * spot.radius
    form = Line("", "", _SELECTION_COLOR, 0.18 * spot.radius)
    return RaisedLine(Polyline(around + np.array([spot.x, spot.y]), form), level)


def _top(line: Polyline, discs: Sequence[Discs]) -> float:
    """Height of the highest of its owner's discs that a line lies on; 0 for none."""
    highest = 0.0
    for batch in discs if line.owner else ():
        rows = np.flatnonzero(np.array(batch.owners) == line.owner)
        for row in rows:
            away = np.hypot(line.points[:, 0] - batch.x[row], line.points[:, 1] - batch.y[row])
            # Details may protrude from their disc, such as arms.
            if away.max() <= 2.5 * batch.radius[row]:
                highest = max(highest, 1.4 * float(batch.height[row]))
    return highest


def ribbon(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Sideways offsets (n, 2) of a ribbon of constant width through n points, and its lengths."""
    steps = np.diff(points, axis=0)
    # Repeated points have no direction.
    lengths = np.maximum(np.hypot(steps[:, 0], steps[:, 1]), 1e-9)
    across = np.stack([-steps[:, 1], steps[:, 0]], axis=1) / lengths[:, None]
    before, after = np.vstack([across[:1], across]), np.vstack([across, across[-1:]])
    middle = before + after
    # Limit the mitre, which would be infinitely long at a sharp corner.
    squared = np.maximum((middle**2).sum(axis=1), 0.8)
    # The bisector of both sides, lengthened such that the width stays constant.
    return 2 * middle / squared[:, None], np.concatenate([[0.0], np.cumsum(lengths)])


class Ribbons:
    """All lines of a picture."""

    def __init__(self, gl: moderngl.Context) -> None:
        self._buffer = GrowingBuffer(gl)
        self._program = program(gl, shaders.RIBBON_VERTEX, shaders.RIBBON_FRAGMENT)
        content = [(self._buffer.buffer, "3f 3f 4f", "where", "off", "paint")]
        self._array = gl.vertex_array(self._program, content)
        self._count = 0

    def take(self, lines: Sequence[RaisedLine]) -> None:
        """Set the lines of a picture."""
        numbers = [_strip(line) for line in lines]
        self._count = sum(map(len, numbers))
        if numbers:
            self._buffer.write(np.concatenate(numbers))

    def draw(self) -> None:
        """Draw all lines."""
        if self._count:
            self._array.render(moderngl.TRIANGLES, vertices=self._count)


def _strip(way: RaisedLine) -> Single:
    """Triangles of a ribbon: position, sideways offset, length so far, colour, width."""
    points, form = way.line.points, way.line.form
    aside, along = ribbon(points)
    # The sign tells the shader which lines are dashed, which saves an attribute.
    width = -form.width if form.dashed else form.width
    n = len(points)
    corners = np.zeros((2, n, 10), np.float32)
    for side, sign in enumerate((1.0, -1.0)):
        corners[side, :, 0:2], corners[side, :, 2] = points, way.level
        corners[side, :, 3:5], corners[side, :, 5] = sign * aside, along
    corners[:, :, 6:9], corners[:, :, 9] = np.array(rgb(form.color)) / 255, width
    left, right = corners
    faces = [right[:-1], right[1:], left[1:], right[:-1], left[1:], left[:-1]]
    return np.stack(faces, axis=1).reshape(-1, 10)


class Fans:
    """Laser beams: a fan per laser, and a dot at each hit."""

    def __init__(self, gl: moderngl.Context) -> None:
        self._buffer = GrowingBuffer(gl)
        self._program = program(gl, shaders.BEAM_VERTEX, shaders.BEAM_FRAGMENT)
        content = [(self._buffer.buffer, "3f 1f", "where", "far")]
        self._array = gl.vertex_array(self._program, content)
        self._fans = self._dots = 0

    def take(self, beams: Sequence[Beams]) -> None:
        """Set the current beams."""
        fans = [_fan(fan) for fan in beams if len(fan.ends) > 1]
        dots = [_hits(fan) for fan in beams if len(fan.ends)]
        self._fans, self._dots = sum(map(len, fans)), sum(map(len, dots))
        if fans or dots:
            self._buffer.write(np.concatenate([*fans, *dots]))

    def draw(self) -> None:
        """Draw all beams."""
        for first, count, color in ((0, self._fans, _FAN), (self._fans, self._dots, _END)):
            if count:
                self._program["color"] = color
                self._array.render(moderngl.TRIANGLES, vertices=count, first=first)


def _fan(beams: Beams) -> Single:
    """A narrow triangle per beam, at its end half as wide as the gap to the next."""
    here = np.array([beams.x, beams.y])
    after = np.roll(beams.ends, -1, axis=0)
    apart = np.hypot(*(after - beams.ends).T)
    reach = np.maximum(np.hypot(*(beams.ends - here).T), 1e-9)
    # The median angle, because adjacent ends at a corner lie far apart.
    wide = np.minimum(np.median(apart / reach) * reach, apart.max()) * 0.25
    out = (beams.ends - here) / reach[:, None]
    aside = np.stack([-out[:, 1], out[:, 0]], axis=1) * wide[:, None]
    triangles = np.zeros((len(beams.ends), 3, 4), np.float32)
    triangles[:, 0, :2] = here
    triangles[:, 1, :2], triangles[:, 2, :2] = beams.ends - aside, beams.ends + aside
    triangles[:, :, 2], triangles[:, 1:, 3] = _BEAM_LEVEL, 1.0
    return triangles.reshape(-1, 4)


def _hits(beams: Beams) -> Single:
    """A small diamond at the end of each beam that hit something."""
    ends = beams.ends[beams.hits]
    triangles = np.zeros((len(ends), 6, 4), np.float32)
    around = np.array([(1, 0), (0, 1), (-1, 0), (1, 0), (-1, 0), (0, -1)]) * _DOT
    triangles[:, :, :2] = ends[:, None, :] + around
    # Above the fan, which would otherwise hide it.
    triangles[:, :, 2] = _BEAM_LEVEL + 0.01
    return triangles.reshape(-1, 4)
