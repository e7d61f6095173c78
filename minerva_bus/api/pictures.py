"""Pictures and films of a run as HTML that needs no network and no kernel."""

from __future__ import annotations

import base64
import html
import json
import secrets
from dataclasses import dataclass, field
from functools import cached_property
from importlib import resources
from pathlib import Path
from string import Template
from typing import Final

from minerva_bus.arguments import path_of
from minerva_bus.files import write_output
from minerva_bus.wording import counted

MAX_PICTURES: Final = 300
"""Pictures of the page; of a longer film it has a part, evenly distributed."""


@dataclass(frozen=True)
class Still:
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

    @property
    def image(self) -> str:
        """The picture as an element of HTML."""
        # As an image, because notebooks remove inline SVG from outputs that they do not trust, and
        # because their style sheets would apply to it.
        data = base64.b64encode(self.svg.encode()).decode("ascii")
        about = html.escape(f"{self.world}, frame {self.frame}")
        return (
            f'<img alt="{about}" src="data:image/svg+xml;base64,{data}"'
            ' style="max-width: 100%; max-height: 30em">'
        )

    def _repr_html_(self) -> str:
        return self.image


# No slots: `cached_property` stores the page in `__dict__`.
@dataclass(frozen=True)
class Film:
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

    @cached_property
    def html(self) -> str:
        """An element of HTML: picture, slider and a button that plays the film."""
        count = min(len(self), MAX_PICTURES)
        step = (len(self) - 1) / max(count - 1, 1)
        shown = [self.pictures[round(number * step)] for number in range(count)]
        # Pictures share most of their lines, such as those of a map.
        lines: dict[str, int] = {}
        documents = [
            [lines.setdefault(line, len(lines)) for line in picture.svg.splitlines()]
            for picture in shown
        ]
        film = {
            "frames": [picture.frame for picture in shown],
            "pictures": documents,
            "lines": [*lines],
        }
        template = (
            resources.files("minerva_bus.api").joinpath("film.html").read_text(encoding="utf-8")
        )
        return Template(template).substitute(
            # Several outputs of a notebook are parts of one page.
            id=f"minerva-film-{secrets.token_hex(4)}",
            image=shown[0].image,
            last=count - 1,
            # "</" would end the script.
            film=json.dumps(film).replace("</", "<\\/"),
        )

    def save(self, path: str | Path) -> None:
        """Write an .html file. Raises MisuseError if it must not be overwritten or written."""
        page = (
            f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
            f"<title>{html.escape(self.pictures[0].world)}</title></head>\n<body>{self.html}</body></html>\n"
        )
        write_output(path_of("path", path), page.encode(), "film")

    def _repr_html_(self) -> str:
        return self.html
