"""Views of a world's strings, and pictures and films of them."""

from __future__ import annotations

import html
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Protocol, TypeAlias

from minerva_bus.entry_points import entries
from minerva_bus.errors import MisuseError, nearest
from minerva_bus.files import check_ending, ending_of, write_output
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.scene import Scene
from minerva_bus.grammar.vocabulary import EventType, Vocabulary
from minerva_bus.launch.console import progress_bar
from minerva_bus.launch.specs import find_service, load
from minerva_bus.launch.world_files import WorldFile
from minerva_bus.values import path_of, text
from minerva_bus.wording import counted
from minerva_bus.world.agent import Agent
from minerva_bus.world.visualization import visualize

Visual: TypeAlias = Event | EventType | str
"""A visual event, or the type of one without data."""
PICTURE: Final = "ePicture"
"""The visual event type that views for people draw by default."""
WIDTH: Final = 640


def displayed(value: object) -> dict[str, Any]:
    """What installed packages show for a value, by type (the entry points `minerva.displays`)."""
    shown: dict[str, Any] = {}
    for entry in entries("minerva.displays").values():
        shown |= load(entry.value)(value)
    return shown


def _svg_view() -> Any:
    # Found by its name, because services import this package.
    return find_service("svg")


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
        """Write an .svg or .png file; a .png needs the extra `picture`.

        Raises MisuseError for another ending, and if it must not be overwritten or written.
        """
        into, svg = path_of("path", path), self.svg
        check_ending(into, (".svg", ".png"), "picture")
        is_svg = ending_of(into) == ".svg"
        write_output(into, svg.encode() if is_svg else _svg_view().png(svg), "picture")


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
        into = path_of("path", path)
        check_ending(into, (".html",), "film")
        shown = displayed(self).get("text/html")
        if shown is None:
            raise MisuseError("no package that displays films is installed: minerva_notebook does")
        page = (
            f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
            f"<title>{html.escape(self.pictures[0].world)}</title></head>\n<body>{shown}</body></html>\n"
        )
        write_output(into, page.encode(), "film")


class PictureSeries(Protocol):
    """A series of SVG documents of one part of a world, which only grows."""

    def draw(self, scene: Scene, frame: int) -> str:
        """The document of a view in a frame."""
        ...

    def film(self, views: Sequence[tuple[int, Scene]]) -> Iterable[str]:
        """The documents of views, of the same part of the world, with the numbers of frames."""
        ...


class WorldViews:
    """Views and pictures of the strings of one world.

    Args:
        name: of the world.
        vocabulary: of the world.
        agents: the classes whose views are known here; a remote world does not send them.

    """

    def __init__(self, name: str, vocabulary: Vocabulary, agents: Iterable[type[Agent]]) -> None:
        self.name = name
        self.vocabulary = vocabulary
        self._agents = tuple(agents)

    def view(self, scene: Scene, event: Visual, frame: int) -> Scene:
        """The view π of a string (equation 5).

        Raises MisuseError if the type is not visual, or if classes of agents are unknown.
        """
        events = self.vocabulary.events
        if not isinstance(event, Event):
            name = event.name if isinstance(event, EventType) else text("event", event)
            if name not in events:
                visual = [each for each in events if events[each].visual]
                hint = nearest(name, [*events]) or f"; visual are: {', '.join(visual) or 'none'}"
                raise MisuseError(f"the world {self.name} has no event type {name}{hint}")
            event = events[name]()
        assert isinstance(event, Event)
        if not events[event.type].visual:
            raise MisuseError(f"{event.type} is not visual: no agent has a view for it")
        known = {cls.kind.name for cls in self._agents}
        for kind in self.vocabulary.kinds.values():
            if event.type in kind.views and kind.name not in known:
                raise MisuseError(
                    f"the class of {kind.name} is not known here: connect(..., agents=[...])"
                )
        return visualize(scene, [event], self._agents, frame)

    def pictures(self, width: int = WIDTH) -> PictureSeries:
        """An empty series of pictures, `width` pixels wide. Raises MisuseError without forms."""
        if all(primitive.shape is None for primitive in self.vocabulary.primitives.values()):
            raise MisuseError(
                f"the world {self.name} has no pictures: no primitive has a form, such as"
                ' Primitive("PBall", Disc(0.5, "#3366cc"))'
            )
        return _svg_view().pictures(self.name, self.vocabulary, width)

    def picture(
        self, scene: Scene, frame: int, event: Visual = PICTURE, width: int = WIDTH
    ) -> Still:
        """A picture of a string. Raises MisuseError, and ActivityError if a view fails."""
        return self.drawn(self.pictures(width), scene, frame, event)

    def drawn(
        self, pictures: PictureSeries, scene: Scene, frame: int, event: Visual = PICTURE
    ) -> Still:
        """The next picture of a series; see `picture`."""
        return Still(self.name, frame, pictures.draw(self.view(scene, event, frame), frame))

    def film(
        self, strings: Sequence[tuple[int, Scene]], event: Visual = PICTURE, width: int = WIDTH
    ) -> Film:
        """A film of strings with the numbers of their frames, at least one."""
        views = [(frame, self.view(scene, event, frame)) for frame, scene in strings]
        pictures = list[Still]()
        with progress_bar("film") as progress:
            for (frame, _), svg in zip(views, self.pictures(width).film(views), strict=True):
                pictures.append(Still(self.name, frame, svg))
                progress(len(pictures), len(views))
        return Film(tuple(pictures))


def views_of(file: WorldFile) -> WorldViews:
    """Views of a world with the classes of its processes."""
    agents = dict.fromkeys(cls for process in file.processes for cls in process.agents)
    return WorldViews(file.world.name, file.world.vocabulary, agents)
