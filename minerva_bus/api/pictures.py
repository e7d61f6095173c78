"""Pictures and films of a run."""

from __future__ import annotations

import html
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from minerva_bus.arguments import path_of
from minerva_bus.entry_points import entries
from minerva_bus.errors import MisuseError
from minerva_bus.files import write_output
from minerva_bus.launch.specs import load
from minerva_bus.wording import counted


def displayed(value: object) -> dict[str, Any]:
    """What installed packages show for a value, by type (the entry points `minerva.displays`)."""
    shown: dict[str, Any] = {}
    for entry in entries("minerva.displays").values():
        shown |= load(entry.value)(value)
    return shown


class Displayed:
    """A value that notebooks display by `displayed`."""

    __slots__ = ()

    def _repr_mimebundle_(self, **_: Any) -> dict[str, Any]:
        return {**displayed(self), "text/plain": repr(self)}


@dataclass(frozen=True, slots=True)
class Still(Displayed):
    """A picture of a string, which notebooks display.

    Attributes:
        world: the name of the world.
        frame: the frame that begins with the string.
        svg: the document.

    """

    world: str
    frame: int
    svg: str = field(repr=False)

    def save(self, path: str | Path) -> None:
        """Write an .svg file. Raises MisuseError if it must not be overwritten or written."""
        write_output(path_of("path", path), self.svg.encode(), "picture")


@dataclass(frozen=True, slots=True)
class Film(Displayed):
    """A film, which notebooks display with a slider.

    Attributes:
        pictures: at least one; all have the same size.

    """

    pictures: tuple[Still, ...] = field(repr=False)

    def __len__(self) -> int:
        return len(self.pictures)

    def __repr__(self) -> str:
        first, last = self.pictures[0], self.pictures[-1]
        count = counted(len(self), "picture")
        return f"<Film of {first.world}: {count}, frames {first.frame} to {last.frame}>"

    def save(self, path: str | Path) -> None:
        """Write an .html file with a slider and a button that plays the film.

        Raises MisuseError if it must not be overwritten or written, or if no installed package
        makes pages of films.
        """
        shown = displayed(self).get("text/html")
        if shown is None:
            raise MisuseError("no package that displays films is installed: minerva_notebook does")
        page = (
            f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
            f"<title>{html.escape(self.pictures[0].world)}</title></head>\n<body>{shown}</body></html>\n"
        )
        write_output(path_of("path", path), page.encode(), "film")
