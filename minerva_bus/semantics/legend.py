"""Legends: what the colours of a picture mean, from the forms of the primitives in it."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import TypeAlias

from minerva_bus.grammar.appearance import Disc, Line, Raster, Shape
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.semantics.colors import is_pale

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
