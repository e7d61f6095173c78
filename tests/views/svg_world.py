"""A small vocabulary with every form, and functions to inspect a picture."""

import io
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray
from PIL import Image

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
    Reals,
    Scene,
    Transformation,
    View,
    Vocabulary,
    WorldInfo,
)
from minerva_services.geometry.colors import DrawnColors
from minerva_services.views.svg.document import Page, Tracer, frame_of, svg_document

WALL, FREE, UNKNOWN = "#2f3640", "#fbfaf6", "#d9d4c7"

PRobot = Primitive("PRobot", Disc(0.25, "#e07a2f", heading=True))
PBall = Primitive("PBall", Disc("radius", "#123456"), radius=Metres)
PPath = Primitive(
    "PPath", Line("xs", "ys", "#aa0000", 0.06, True), xs=tuple[float, ...], ys=tuple[float, ...]
)
PSign = Primitive("PSign", Label("words", "#008800"), words=str)
PMap = Primitive(
    "PMap",
    Raster("cells", "cell", "x", "y", "angle", colors=((-1, UNKNOWN), (0, FREE), (1, WALL))),
    cells=Cells,
    cell=Metres,
    x=Default(Metres, 0.0),
    y=Default(Metres, 0.0),
    angle=Default(Degrees, 0.0),
)
PHeat = Primitive(
    "PHeat", Raster("heat", 0.5, colors=((0, ""), (1, "#ff0000")), opacity=0.5), heat=Reals
)
PUgly = Primitive("PUgly", Disc(1.0, 'red"/><script/>'))
PInner = Primitive("PInner")
TMove = Transformation(
    "TMove", Motion("x", "y", "turn", "ahead"),
    x=Default(Metres, 0.0), y=Default(Metres, 0.0),
    turn=Default(Degrees, 0.0), ahead=Default(Metres, 0.0),
)  # fmt: skip
TStill = Transformation("TStill")

VOCABULARY = Vocabulary.of(
    PRobot, PBall, PPath, PSign, PMap, PHeat, PUgly, PInner, TMove, TStill,
    EventType("ePicture", visual=True), EventType("eOverlay", visual=True),
)  # fmt: skip
WORLD = WorldInfo("orchard", VOCABULARY, 7, 0.1)


def page_of(scene: Scene, width: int = 1200) -> Page:
    return Page(frame_of(scene, VOCABULARY), width)


def picture(scene: Scene, width: int = 1200) -> str:
    drawn = DrawnColors()
    page = Page(frame_of(scene, VOCABULARY, None, drawn), width)
    shown = drawn.legend(VOCABULARY)
    return svg_document(scene, VOCABULARY, page, Tracer(), "orchard", "frame 3", shown)


def elements(document: str, tag: str) -> list[ElementTree.Element]:
    """The elements of a document with this tag, in document order, without its legend."""
    root = ElementTree.fromstring(document)
    for swatches in root.findall("{*}g[@class='legend']"):
        root.remove(swatches)
    return list(root.iter("{http://www.w3.org/2000/svg}" + tag))


def pixels(png: bytes) -> NDArray[np.uint8]:
    """Red, green and blue of a PNG, [y, x, 3]."""
    with Image.open(io.BytesIO(png)) as image:
        return np.asarray(image.convert("RGB"))


def view(frame: int, scene: Scene, event_type: str = "ePicture") -> View:
    return View(frame, event_type, scene)
