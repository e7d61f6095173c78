"""A small world to be drawn in three dimensions, and functions to inspect the drawing."""

from functools import cache

import numpy as np
import pytest

from minerva_bus import (
    Cells,
    Default,
    Degrees,
    Disc,
    EventType,
    Label,
    Line,
    Metres,
    Motion,
    Primitive,
    Raster,
    Transformation,
    View,
    Vocabulary,
    WorldInfo,
)
from minerva_bus.errors import MisuseError
from minerva_bus.semantics.picture import Lists
from minerva_services.views.window.painter import Sight

pytest.importorskip("moderngl", reason="moderngl is not installed")
pytest.importorskip("pygame", reason="pygame-ce is not installed")

from minerva_services.views.opengl.canvas import without_window
from minerva_services.views.opengl.painter import GLPainter

WALL, FREE = "#2f3640", "#fbfaf6"
ROBOT, BALL, PIN = (224, 122, 47), (30, 60, 220), (0, 136, 0)

PRobot = Primitive("PRobot", Disc("radius", "#e07a2f", heading=True), name=str, radius=Metres)
PBall = Primitive("PBall", Disc("radius", "#1e3cdc", height=0.4), radius=Metres)
PWay = Primitive(
    "PWay", Line("xs", "ys", "#aa0000", 0.2), xs=tuple[float, ...], ys=tuple[float, ...]
)
PSign = Primitive("PSign", Label("words", "#008800"), words=str)
PMap = Primitive(
    "PMap",
    Raster("cells", "cell", "x", "y", "angle", colors=((0, FREE), (1, WALL)), height=1.0),
    cells=Cells, cell=Metres, x=Default(Metres, 0.0), y=Default(Metres, 0.0),
    angle=Default(Degrees, 0.0),
)  # fmt: skip
PHeat = Primitive(
    "PHeat", Raster("cells", 0.5, colors=((0, ""), (1, "#ff0000")), opacity=0.5), cells=Cells
)
TPut = Transformation(
    "TPut", Motion("x", "y", "angle"), x=Metres, y=Metres, angle=Default(Degrees, 0.0)
)
VOCABULARY = Vocabulary.of(
    PRobot, PBall, PWay, PSign, PMap, PHeat, TPut, EventType("ePicture", visual=True),
)  # fmt: skip
WORLD = WorldInfo("orchard", VOCABULARY, 7, 0.1)


PAINTERS = []
"""The painters of a test; each holds a context of the driver until it is closed."""


@cache
def has_driver():
    try:
        without_window().release()
    except MisuseError:
        return False
    return True


# A text, evaluated when a test begins: the driver starts threads, which a fork would not have.
needs_driver = pytest.mark.skipif(
    "not __import__('opengl_world').has_driver()", reason="there is no OpenGL driver (EGL) here"
)


def floor(rows=60, columns=40, cell=0.2):
    """Free cells within walls; row 10 is a wall across."""
    cells = np.zeros((rows, columns), np.int16)
    cells[[0, -1]], cells[:, [0, -1]] = 100, 100
    cells[10] = 100
    return PMap(cells, cell)


def picture(scene):
    return Lists(VOCABULARY).picture(scene, {})


def drawn(scene, size=(900, 600), camera=(-90.0, 60.0, 1.0), **more):
    """A painter that has drawn a string, and its pixels."""
    painter = GLPainter(*camera)
    painter.offscreen(size)
    PAINTERS.append(painter)
    painter.draw(Sight(picture(scene), **more))
    pixels = painter.pixels()
    assert pixels.shape == (size[1], size[0], 3)
    return painter, pixels


def like(pixels, color, tolerance=12):
    """The positions of pixels of a colour, up to a tolerance, as (x, y) of shape (n, 2)."""
    near = (np.abs(pixels.astype(int) - np.array(color)) <= tolerance).all(axis=2)
    return np.argwhere(near)[:, ::-1]


def at(painter, x, y, z):
    """The pixel (x, y) of a place."""
    pixel = painter.project(*(np.array([value], float) for value in (x, y, z)))
    return np.array([pixel[0][0], pixel[1][0]])


def view(frame, scene):
    return View(frame, "ePicture", scene)
