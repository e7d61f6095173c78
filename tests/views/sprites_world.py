"""A small world with floor, robot, plan and sign, and functions to inspect drawings."""

import numpy as np

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
    Scene,
    Transformation,
    View,
    Vocabulary,
    WorldInfo,
)
from minerva_services.geometry.picture import Lists
from minerva_services.views.sprites.painter import SpritePainter
from minerva_services.views.window.painter import Sight

WALL, FREE = "#2f3640", "#fbfaf6"
ROBOT, DOT = (224, 122, 47), (18, 52, 86)

PRobot = Primitive("PRobot", Disc("radius", "#e07a2f", heading=True), name=str, radius=Metres)
PDot = Primitive("PDot", Disc("radius", "#123456"), radius=Metres)
PPath = Primitive(
    "PPath", Line("xs", "ys", "#aa0000", 0.1), xs=tuple[float, ...], ys=tuple[float, ...]
)
PSign = Primitive("PSign", Label("words", "#008800"), words=str)
PMap = Primitive(
    "PMap",
    Raster("cells", "cell", "x", "y", "angle", colors=((0, FREE), (1, WALL)), height=1.0),
    cells=Cells, cell=Metres, x=Default(Metres, 0.0), y=Default(Metres, 0.0),
    angle=Default(Degrees, 0.0),
)  # fmt: skip
PUgly = Primitive("PUgly", Disc(0.5, "no colour at all"))
TPut = Transformation(
    "TPut", Motion("x", "y", "angle"), x=Metres, y=Metres, angle=Default(Degrees, 0.0)
)
VOCABULARY = Vocabulary.of(
    PRobot, PDot, PPath, PSign, PMap, PUgly, TPut, EventType("ePicture", visual=True),
    EventType("eOverlay", visual=True), EventType("eGo", place=str),
)  # fmt: skip
WORLD = WorldInfo("orchard", VOCABULARY, 7, 0.1)


def floor(rows=80, columns=50, cell=0.1):
    """Free cells within walls; row 10 is a wall across."""
    cells = np.zeros((rows, columns), np.int16)
    cells[[0, -1]], cells[:, [0, -1]] = 100, 100
    cells[10] = 100
    return PMap(cells, cell)


def picture(scene):
    return Lists(VOCABULARY).picture(scene, {})


def drawn(scene, size=(900, 640), **more):
    """A painter that has drawn a string, and its pixels."""
    painter = SpritePainter()
    painter.offscreen(size)
    painter.draw(Sight(picture(scene), **more))
    return painter, painter.pixels()


def middle_of(pixels, color, tolerance=12):
    """The centre (x, y) of all pixels of a colour, and their number; None without any."""
    near = (np.abs(pixels.astype(int) - np.array(color)) <= tolerance).all(axis=2)
    rows, columns = np.nonzero(near)
    return (columns.mean(), rows.mean(), len(rows)) if len(rows) else None


def view(frame: int, scene: Scene, event_type: str = "ePicture") -> View:
    return View(frame, event_type, scene)
