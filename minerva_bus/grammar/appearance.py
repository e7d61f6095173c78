"""Appearance of symbols, for geometric systems without code for them.

A primitive may declare a `Shape`, a transformation a `Motion`. Both are plain data that are sent
with the vocabulary, so a picture, a window or a web page can draw worlds whose code it lacks. A
measure is a number, or the name of the symbol's parameter that has it. Lengths are in metres,
angles in degrees, counter-clockwise from the x axis. The `meaning` of a shape is its text in the
legend of a view; without one, the legend has the words of the primitive's name.

These forms are those of the plane. `spatial` is the meaning of the same symbol in space: the name
of a form, then its measures, for geometric systems that know it, such as those of the extension
`bodies`. Views of the plane do not use it.
"""

import re
from dataclasses import dataclass
from typing import TypeAlias

Measure: TypeAlias = float | str
Spatial: TypeAlias = tuple[Measure, ...]


@dataclass(frozen=True, slots=True)
class Motion:
    """A motion of the plane: translation by (x, y), rotation, translation along the new x axis.

    Each attribute is a number, or the name of the transformation's parameter that has it.

    Attributes:
        x, y: translation, metres.
        turn: rotation, degrees, counter-clockwise.
        forward: translation along the x axis after the rotation, metres.
        spatial: the same motion in space; see the module.

    Example:
        `TAt = Transformation("TAt", Motion(x="x", y="y"), x=Metres, y=Metres)`

    """

    x: Measure = 0.0
    y: Measure = 0.0
    turn: Measure = 0.0
    forward: Measure = 0.0
    spatial: Spatial = ()


@dataclass(frozen=True, slots=True)
class Disc:
    """A disc around the origin.

    Attributes:
        radius: metres, or the name of the parameter that has it.
        color: `#rrggbb`, or by the value of a parameter: `viridis(age, 0, 10)`, see docs/views.md.
        heading: whether a mark shows the direction of its x axis.
        height: metres, in three dimensions.
        meaning: text of the legend; "" for the words of the primitive's name.
        spatial: the solid in space whose outline this is; see the module.

    Example:
        `PSnail = Primitive("PSnail", Disc(0.2, "#8a5a44"))`

    """

    radius: Measure = 0.1
    color: str = "#444444"
    heading: bool = False
    height: float = 0.3
    meaning: str = ""
    spatial: Spatial = ()


@dataclass(frozen=True, slots=True)
class Line:
    """A line through points.

    Attributes:
        xs, ys: names of two parameters of type `tuple[Metres, ...]` with the coordinates.
        color: `#rrggbb`.
        width: metres.
        dashed: whether the line is dashed.
        meaning: text of the legend; "" for the words of the primitive's name.
        spatial: its meaning in space; see the module.

    Example:
        `PPath = Primitive("PPath", Line("xs", "ys"), xs=tuple[Metres, ...], ys=tuple[Metres, ...])`

    """

    xs: str
    ys: str
    color: str = "#444444"
    width: float = 0.04
    dashed: bool = False
    meaning: str = ""
    spatial: Spatial = ()


@dataclass(frozen=True, slots=True)
class Label:
    """The text of a parameter, on a small pin at the origin.

    Attributes:
        text: name of the parameter that has the text.
        color: `#rrggbb`.
        meaning: text of the legend; "" for the words of the primitive's name.
        marks: whether it draws no pin of its own but gives its colour to all other labels with the
            same text, wherever they are: for example, to the marker that an agent looks for.
        spatial: its meaning in space; see the module.

    Example:
        `PMarker = Primitive("PMarker", Label("name"), name=str)`

    """

    text: str
    color: str = "#444444"
    meaning: str = ""
    marks: bool = False
    spatial: Spatial = ()


@dataclass(frozen=True, slots=True)
class Raster:
    """A matrix parameter as squares: cell [row, column] at x + row·cell, y + column·cell.

    `colors` pairs the lower bound of each range with a colour ("" draws nothing), in ascending
    order; a value has the colour of the last range whose bound does not exceed it. `opacity` is
    from 0 to 1. `meanings` are the legend's texts of the ranges, in their order; "" leaves a range
    out. `spatial` is its meaning in space; see the module.
    """

    cells: str
    cell: Measure
    x: Measure = 0.0
    y: Measure = 0.0
    turn: Measure = 0.0
    colors: tuple[tuple[int, str], ...] = ((1, "#444444"),)
    opacity: float = 1.0
    height: float = 0.0
    meanings: tuple[str, ...] = ()
    spatial: Spatial = ()


_SCALED = re.compile(r"^[\w# ]+\( *(\w+)")


def parameters_of(form: "Form") -> tuple[str, ...]:
    """The names of the symbol's parameters that a form uses."""
    if isinstance(form, Motion):
        measures = (form.x, form.y, form.turn, form.forward)
    elif isinstance(form, Disc):
        measures = (form.radius, *_SCALED.findall(form.color))
    elif isinstance(form, Line):
        measures = (form.xs, form.ys)
    elif isinstance(form, Label):
        measures = (form.text,)
    else:
        measures = (form.cells, form.cell, form.x, form.y, form.turn)
    used = (*measures, *form.spatial[1:])
    return tuple(measure for measure in used if isinstance(measure, str))


Shape: TypeAlias = Disc | Line | Label | Raster
Form: TypeAlias = Shape | Motion
