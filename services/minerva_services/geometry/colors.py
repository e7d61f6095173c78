"""Colours of forms as numbers, and legends: what the colours of a picture mean."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Final, TypeAlias

from minerva_bus.grammar.appearance import Disc, Line, Raster, Shape
from minerva_bus.grammar.vocabulary import Vocabulary

Color: TypeAlias = tuple[int, int, int]
"""Red, green and blue from 0 to 255."""

OKABE_ITO: Final = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
"""Colours that people with colour-vision deficiency can also distinguish (Okabe and Ito, 2008)."""


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

    A raster without meanings has several colours: the shades of one primitive. `opacity` is from
    0 to 1.
    """

    text: str
    shape: type[Shape]
    colors: tuple[str, ...]
    opacity: float = 1.0
    dashed: bool = False
    heading: bool = False

    @property
    def on_dark(self) -> bool:
        """Whether this is a line too pale for paper: its swatch has a dark ground.

        Discs and matrices have an outline.
        """
        return self.shape is Line and is_pale(self.colors[0])


Legend: TypeAlias = tuple[LegendEntry, ...]


def words(name: str) -> str:
    """The words of a symbol's or event type's name: `big tree` for `PBigTree`."""
    return " ".join(_WORDS.findall(name[1:])).lower() or name


def legend(vocabulary: Vocabulary, symbols: Collection[str]) -> Legend:
    """The legend of a picture that shows these primitives: things in it, then matrices."""
    shapes = {name: p.shape for name, p in vocabulary.primitives.items() if name in symbols}
    entries = [
        entry
        for name, shape in sorted(shapes.items(), key=lambda item: isinstance(item[1], Raster))
        if shape is not None
        for entry in _entries(name, shape)
    ]
    return tuple(dict.fromkeys(entries))


def _entries(name: str, shape: Shape) -> Iterator[LegendEntry]:
    if not isinstance(shape, Raster):
        heading = isinstance(shape, Disc) and shape.heading
        dashed = isinstance(shape, Line) and shape.dashed
        text = shape.meaning or words(name)
        yield LegendEntry(text, type(shape), (shape.color,), 1.0, dashed, heading)
    elif shape.meanings:
        for text, (_, color) in zip(shape.meanings, shape.colors, strict=False):
            if text and color:
                yield LegendEntry(text, Raster, (color,), shape.opacity)
    else:
        colors = tuple([color for _, color in shape.colors if color])
        if colors:
            yield LegendEntry(words(name), Raster, colors, shape.opacity)
