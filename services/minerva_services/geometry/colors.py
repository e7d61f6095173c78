"""Colours of forms as numbers, and legends: what the colours of a picture mean."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import MisuseError, nearest
from minerva_bus.grammar.appearance import Disc, Line, Raster, Shape
from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_services.geometry.volumes import color_ranges

Color: TypeAlias = tuple[int, int, int]
"""Red, green and blue from 0 to 255."""

OKABE_ITO: Final = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
"""Colours that people with colour-vision deficiency can also distinguish (Okabe and Ito, 2008)."""


GROUPS: Final = "groups"
SCALES: Final[Mapping[str, tuple[str, ...]]] = {
    "viridis": (
        *("#440154", "#482878", "#3e4989", "#31688e", "#26828e"),
        *("#1f9e89", "#35b779", "#6ece58", "#b5de2b", "#fde725"),
    ),
    "inferno": (
        *("#000004", "#1b0c41", "#4a0c6b", "#781c6d", "#a52c60"),
        *("#cf4446", "#ed6925", "#fb9b06", "#f7d13d", "#fcffa4"),
    ),
    "greens": ("#e5f5e0", "#c7e9c0", "#a1d99b", "#74c476", "#41ab5d", "#238b45", "#006d2c"),
    "blues": ("#deebf7", "#c6dbef", "#9ecae1", "#6baed6", "#4292c6", "#2171b5", "#08519c"),
    "reds": ("#fee0d2", "#fcbba1", "#fc9272", "#fb6a4a", "#ef3b2c", "#cb181d", "#a50f15"),
    "coolwarm": ("#3b4cc0", "#6788ee", "#9abbff", "#dddddd", "#f7a889", "#e26952", "#b40426"),
    GROUPS: OKABE_ITO,
}
"""Colours of the named scales, from low to high; a value has the colour of its interval."""

_COLOR: Final = re.compile(r"#(?:[0-9a-fA-F]{3}|[0-9a-fA-F]{6})|[A-Za-z]+")
_SCALED: Final = re.compile(r"(\w+|#[#\w ]+)\( *(\w+) *, *([-+.\w]+) *, *([-+.\w]+) *\)")


@dataclass(frozen=True, slots=True)
class Scale:
    """Colours of the values of a parameter: `viridis(age, 0, 10)`.

    The range is divided into equal intervals, one for each colour of the scale; values outside
    have the colour of the nearest end. The colours of `groups` are entries of the legend.
    """

    parameter: str
    low: float
    high: float
    colors: tuple[str, ...]
    groups: bool = False

    def intervals(self, values: NDArray[Any]) -> NDArray[np.int64]:
        """The number of each value's colour. Raises MisuseError for texts."""
        try:
            part = (values.astype(np.float64) - self.low) / (self.high - self.low)
        except ValueError:
            raise MisuseError(
                f"a colour is that of {self.parameter}, which is no number: {values[0]!r:.40}"
            ) from None
        return np.clip(part * len(self.colors), 0, len(self.colors) - 1).astype(np.int64)


@lru_cache(maxsize=1024)
def scale_of(color: str) -> Scale | None:
    """The scale that a form's colour names, or None for a plain colour. Raises MisuseError."""
    read = _SCALED.fullmatch(color)
    if read is None and "(" in color:
        raise MisuseError(
            f"{color!r:.80} is not a scale of colours; expected such as viridis(age, 0, 10), or"
            " colours #rrggbb in a list: #009e73 #d55e00(state, 0, 2)"
        )
    if read is None:
        return None
    name, parameter, *ends = read.groups()
    own = tuple(name.split()) if name.startswith("#") else ()
    for each in own:
        check_color(each)
    try:
        low, high = map(float, ends)
    except ValueError:
        low, high = math.nan, math.nan
    if not (own or name in SCALES) or not -math.inf < low < high < math.inf:
        raise MisuseError(
            f"{color!r} is not a scale of colours; expected such as viridis({parameter}, 0, 10),"
            f" with one of {', '.join(SCALES)}{nearest(name, list(SCALES))}"
        )
    # Each group has a colour of its own, so as many are used as there are numbers.
    colors = own or SCALES[name][: int(high - low) if name == GROUPS else None]
    return Scale(parameter, low, high, colors, bool(own) or name == GROUPS)


def check_color(color: str) -> None:
    """Raise MisuseError if this is neither a colour nor a scale of colours."""
    if scale_of(color) is None:
        paint(color)


def paint(color: str) -> str:
    """A plain colour, which is safe in an attribute. Raises MisuseError if it is invalid."""
    if not _COLOR.fullmatch(color):
        raise MisuseError(f"{color[:40]!r} is not a colour; expected #rrggbb or a name")
    return color


def color_of(color: str, parameters: Mapping[str, Any]) -> str:
    """The colour of a figure: the form's own, or that of the value on its scale."""
    scale = scale_of(color)
    if scale is None:
        return color
    return scale.colors[int(scale.intervals(np.array([parameters[scale.parameter]]))[0])]


def colors_of(color: str, level: Columns) -> list[str]:
    """The colours of figures in columns; see `color_of`."""
    scale = scale_of(color)
    if scale is None:
        return [color] * level.count
    numbers = scale.intervals(level.column(scale.parameter)).tolist()
    return [scale.colors[number] for number in numbers]


def rgbs_of(color: str, level: Columns) -> NDArray[np.uint8]:
    """The colours of n figures in columns as numbers, shape (n, 3)."""
    scale = scale_of(color)
    if scale is None:
        return np.tile(np.array(rgb(color), np.uint8), (level.count, 1))
    numbers = scale.intervals(level.column(scale.parameter))
    return np.array([rgb(shade) for shade in scale.colors], np.uint8)[numbers]


@lru_cache(maxsize=1024)
def rgb(color: str) -> Color:
    """A colour `#rrggbb` or `#rgb` as numbers from 0 to 255; grey for any other text."""
    digits = color.removeprefix("#")
    digits = "".join(2 * digit for digit in digits) if len(digits) == 3 else digits
    try:
        red, green, blue = bytes.fromhex(digits)
    except ValueError:
        return (0x88, 0x88, 0x88)
    return red, green, blue


def is_pale(color: str) -> bool:
    """Whether a line of this colour is hard to see on paper.

    Its relative luminance (WCAG 2.2, with the approximate exponent 2.2) is above 0.7.
    """
    red, green, blue = [(part / 255) ** 2.2 for part in rgb(color)]
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue > 0.7


_WORDS = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")


@dataclass(frozen=True, slots=True)
class LegendEntry:
    """A text, and the colours of its swatch, which has the look of the shape.

    Several colours are the shades of a raster without meanings, a scale, or those of things with
    the same text. `opacity` is from 0 to 1.
    """

    text: str
    shape: type[Shape]
    colors: tuple[str, ...]
    opacity: float = 1.0
    dashed: bool = False
    heading: bool = False

    @property
    def swatch(self) -> type[Shape]:
        """The shape that the swatch looks like; several colours are a strip, as of a matrix."""
        return self.shape if len(self.colors) == 1 else Raster

    @property
    def on_dark(self) -> bool:
        """Whether this is a line too pale for paper: its swatch has a dark ground.

        Discs and matrices have an outline.
        """
        return self.swatch is Line and is_pale(self.colors[0])


Legend: TypeAlias = tuple[LegendEntry, ...]


def words(name: str) -> str:
    """The words of a symbol's or event type's name: `big tree` for `PBigTree`."""
    return " ".join(_WORDS.findall(name[1:])).lower() or name


class DrawnColors:
    """What pictures have shown so far: the colours of each primitive, for their legend."""

    def __init__(self) -> None:
        self._colors: dict[str, set[str]] = {}

    def __len__(self) -> int:
        return sum(map(len, self._colors.values()))

    def figure(self, symbol: str, shape: Shape, parameters: Mapping[str, Any]) -> None:
        """Include a figure. The colours of a matrix are those that its cells have."""
        if isinstance(shape, Raster):
            numbers = np.bincount(color_ranges(parameters[shape.cells], shape.colors).ravel())
            shown = {shape.colors[at - 1][1] for at in numbers.nonzero()[0].tolist() if at}
        else:
            shown = {color_of(shape.color, parameters)}
        self._colors.setdefault(symbol, set()).update(shown)

    def columns(self, symbol: str, color: str, level: Columns) -> None:
        """Include figures in columns; `color` is that of their form."""
        known = self._colors.setdefault(symbol, set())
        scale = scale_of(color)
        if scale is None:
            known.add(color)
        else:
            numbers = np.bincount(scale.intervals(level.column(scale.parameter)))
            known.update(scale.colors[at] for at in numbers.nonzero()[0].tolist())

    def legend(self, vocabulary: Vocabulary) -> Legend:
        """The legend of the pictures."""
        return legend(vocabulary, self._colors)


def legend(vocabulary: Vocabulary, colors: Mapping[str, Collection[str]]) -> Legend:
    """The legend of a picture that shows primitives in these colours: things, then matrices."""
    shapes = {name: p.shape for name, p in vocabulary.primitives.items() if name in colors}
    return merged(
        entry
        for name, shape in sorted(shapes.items(), key=lambda item: isinstance(item[1], Raster))
        if shape is not None
        for entry in _entries(name, shape)
        # A swatch of several colours is a scale, which is understood as a whole.
        if len(entry.colors) != 1 or entry.colors[0] in colors[name]
    )


def merged(entries: Iterable[LegendEntry]) -> Legend:
    """A legend that lists each text of a shape once, with all of its colours."""
    known = dict[tuple[str, type[Shape]], LegendEntry]()
    for entry in entries:
        first = known.setdefault((entry.text, entry.shape), entry)
        colors = tuple(dict.fromkeys((*first.colors, *entry.colors)))
        if colors != first.colors:
            known[entry.text, entry.shape] = replace(first, colors=colors)
    return tuple(known.values())


def _entries(name: str, shape: Shape) -> Iterator[LegendEntry]:
    if not isinstance(shape, Raster):
        heading = isinstance(shape, Disc) and shape.heading
        dashed = isinstance(shape, Line) and shape.dashed
        text = shape.meaning or words(name)
        scale = scale_of(shape.color)
        if scale is not None and scale.groups:
            names = [part.strip() for part in text.split(",")]
            if len(names) != len(scale.colors):
                numbers = range(len(scale.colors))
                names = [f"{text}: {scale.parameter} {scale.low + n:g}" for n in numbers]
            for name, color in zip(names, scale.colors, strict=True):
                yield LegendEntry(name, Disc, (color,), heading=heading)
            return
        if scale is not None:
            ends = f"{scale.parameter} {scale.low:g} to {scale.high:g}"
            yield LegendEntry(f"{text}: {ends}", Raster, scale.colors)
            return
        yield LegendEntry(text, type(shape), (shape.color,), 1.0, dashed, heading)
    elif shape.meanings:
        for text, (_, color) in zip(shape.meanings, shape.colors, strict=False):
            if text and color:
                yield LegendEntry(text, Raster, (color,), shape.opacity)
    else:
        shades = [(bound, color) for bound, color in shape.colors if color]
        if shades:
            (low, _), (high, _) = shades[0], shades[-1]
            # Few shades are kinds, such as free and occupied, not a scale.
            ends = f": {low:g} to {high:g}" if len(shades) > 3 else ""
            colors = tuple([color for _, color in shades])
            yield LegendEntry(words(name) + ends, Raster, colors, shape.opacity)
