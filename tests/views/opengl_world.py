"""A small world to be drawn in three dimensions, and functions to inspect the drawing."""

from functools import cache

import numpy as np
import pytest
import sprites_world
from sprites_world import PMap, PRobot, PSign, TPut

from minerva_bus import (
    Cells,
    Disc,
    EventType,
    Line,
    Metres,
    Primitive,
    Raster,
    Vocabulary,
    WorldInfo,
)
from minerva_bus.errors import MisuseError
from minerva_services.geometry.picture import Lists
from minerva_services.views.window.painter import Sight

pytest.importorskip("moderngl", reason="moderngl is not installed")
pytest.importorskip("pygame", reason="pygame-ce is not installed")

from minerva_services.views.opengl.canvas import without_window
from minerva_services.views.opengl.painter import GLPainter

BALL, PIN = (30, 60, 220), (0, 136, 0)

PBall = Primitive("PBall", Disc("radius", "#1e3cdc", height=0.4), radius=Metres)
PWay = Primitive(
    "PWay", Line("xs", "ys", "#aa0000", 0.2), xs=tuple[float, ...], ys=tuple[float, ...]
)
PHeat = Primitive(
    "PHeat", Raster("cells", 0.5, colors=((0, ""), (1, "#ff0000")), opacity=0.5), cells=Cells
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


def floor():
    return sprites_world.floor(60, 40, 0.2)


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
