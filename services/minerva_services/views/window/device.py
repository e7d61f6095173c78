"""A view in a window, in pictures or in a video: everything but the drawing."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from itertools import chain
from pathlib import Path

from minerva_bus.errors import MisuseError
from minerva_bus.semantics.picture import Lists, Picture
from minerva_bus.world.readings import Reading
from minerva_bus.world.services import Device, View, WorldInfo
from minerva_services.options import event_types
from minerva_services.views.window.beams import Scans
from minerva_services.views.window.caption import caption
from minerva_services.views.window.hands import Hands
from minerva_services.views.window.painter import Painter, Sight
from minerva_services.views.window.pictures import Pictures
from minerva_services.views.window.roles import check_named
from minerva_services.views.window.screen import quiet
from minerva_services.views.window.showing import Medium, Showing
from minerva_services.views.window.video import Film, Timing
from minerva_services.views.window.watch import Watch


class WindowDevice(Device):
    """Base of views that a `Painter` draws.

    A window is interactive: keys and mouse are a person's hands on the world, and closing it means
    to leave. Pictures are written by an observer, a video by a coupled device that misses nothing.
    """

    topics = ("scan",)

    def __init__(self, showing: Showing, draws: str = "ePicture") -> None:
        self.showing = showing
        self.draws = event_types(showing.service, draws)
        self.every, self.rate = showing.asks_every, showing.rate
        self.interactive = showing.medium is Medium.WINDOW
        self.coupled = showing.medium is Medium.VIDEO  # pyright: ignore
        self.pulse_every = 1 / 30 if self.interactive else 0.0
        self._scans = Scans()
        self._views: dict[str, View] = {}
        self._painter: Painter | None = None
        self._watch: Watch | None = None
        self._pictures: Pictures | None = None
        self._film: Film | None = None
        self._changed = True
        self._closed = False

    @abstractmethod
    def painter(self) -> Painter:
        """The geometric system that draws, made when the world is joined."""

    # --- what the world calls ---

    def joined(self, world: WorldInfo) -> None:
        """Open what is drawn on. Raises MisuseError."""
        show = self.showing
        check_named(show.service, world.vocabulary, show.click, show.slide)
        self._world = world
        self._lists = {one: Lists(world.vocabulary) for one in self.draws}
        self._picture = Picture()
        self.hands = Hands(world.vocabulary, show.click, show.slide, show.follow)
        quiet()
        self._painter = painter = self.painter()
        if show.medium is Medium.WINDOW:
            from minerva_services.views.window.events import Input

            painter.open(f"{world.world}, {show.service}", show.size)
            self._watch = Watch(world.operator)
            self._input = Input(self.hands, painter, self._watch.do)
            return
        painter.offscreen(show.size)
        if show.medium is Medium.PICTURES:
            self._pictures = Pictures(show.path, show.frames)
        else:
            suffix = Path(show.video).suffix.lower()
            self._timing = Timing.of(world.dt, show.speed, self.every, show.fps, suffix)
            self._film = Film(show.video, show.size, self._timing.fps)

    def heard(self, reading: Reading) -> None:
        self._scans.take(reading)

    def show(self, view: View) -> None:
        self._views[view.event_type] = view
        self._changed = True
        if self._pictures is not None:
            self._draw()
            self._pictures.add(view.frame, self._painted.pixels())
        elif self._film is not None and (times := self._timing.times(view.frame)):
            self._draw()
            pixels = self._painted.pixels()
            for _ in range(times):
                self._film.add(pixels)

    def pulse(self) -> None:
        """Look at keys and mouse, and draw what has changed."""
        if self._watch is None:
            return
        if self._watch.status is not None and not self._watch.busy:
            self.hands.know(self._watch.status)
        touched = self._input.look(self._picture)
        told = self._told()
        if touched or self._changed or told != self._shown:
            self._shown = told
            self._draw()

    def leaves(self) -> bool:
        return self._watch is not None and self._input.closed

    def report(self) -> Mapping[str, bool | int | float | str]:
        if self._pictures is not None and self._pictures.written is not None:
            return {"picture": str(self._pictures.written)}
        if self._film is not None and self._film.pictures:
            return {"video": self.showing.video}
        return {}

    def close(self) -> None:
        if self._closed:
            return
        self._closed = True
        if self._watch is not None:
            self._watch.close()
        if self._painter is not None:
            self._painter.close()
        if self._film is not None:
            self._film.close()

    # --- drawing ---

    @property
    def _painted(self) -> Painter:
        if self._painter is None:
            raise MisuseError(f"{self.showing.service}: a view came before the world was joined")
        return self._painter

    _shown: tuple[str, ...] = ()

    def _draw(self) -> None:
        self._changed = False
        views = [self._views[one] for one in self.draws if one in self._views]
        pictures = [self._lists[one.event_type].picture(one.skeleton, one.parts) for one in views]
        items = chain.from_iterable(one.items for one in pictures)
        self._picture = pictures[0] if len(pictures) == 1 else Picture(tuple(items))
        frame = max((one.frame for one in views), default=0)
        hands = self.hands
        time = frame * self._world.dt
        title, subtitle, notice = self._told()
        self._painted.draw(
            Sight(
                self._picture,
                tuple(self._scans.beams(self._picture, time)) if hands.beams else (),
                title,
                subtitle,
                notice,
                hands.help if hands.helps else (),
                hands.selected,
                hands.follows,
            )
        )

    def _told(self) -> tuple[str, str, str]:
        frame = max((one.frame for one in self._views.values()), default=-1)
        status = self._watch.status if self._watch is not None else None
        subtitle = caption(frame, self._world.dt, status, self.hands.doing)
        return self._world.world, subtitle, self._watch.notice if self._watch is not None else ""
