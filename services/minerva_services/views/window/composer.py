"""The picture of a world's latest views, with status line and laser beams."""

from __future__ import annotations

from itertools import chain

from minerva_bus.semantics.picture import Lists, Picture
from minerva_bus.world.operator import WorldStatus
from minerva_bus.world.readings import Reading
from minerva_bus.world.services import View, WorldInfo
from minerva_services.views.window.beams import ScanBuffer
from minerva_services.views.window.caption import caption
from minerva_services.views.window.controls import WindowControls
from minerva_services.views.window.painter import Sight


class Composer:
    """Combines the views of several event types to one picture."""

    def __init__(self, world: WorldInfo, draws: tuple[str, ...]) -> None:
        self._world = world
        self._lists = {event_type: Lists(world.vocabulary) for event_type in draws}
        self._views: dict[str, View] = {}
        self._scans = ScanBuffer()
        self.picture = Picture()

    def add_view(self, view: View) -> None:
        """Replace the view of its event type."""
        self._views[view.event_type] = view

    def add_reading(self, reading: Reading) -> None:
        """Keep a scan, to draw its beams."""
        self._scans.add(reading)

    def compose(self, controls: WindowControls, text: tuple[str, str, str]) -> Sight:
        """Everything to display; `text` is title, subtitle and notice."""
        views = [self._views[kind] for kind in self._lists if kind in self._views]
        pictures = [
            self._lists[view.event_type].picture(view.skeleton, view.parts) for view in views
        ]
        items = chain.from_iterable(picture.items for picture in pictures)
        self.picture = pictures[0] if len(pictures) == 1 else Picture(tuple(items))
        time = max((view.frame for view in views), default=0) * self._world.dt
        return Sight(
            self.picture,
            tuple(self._scans.beams(self.picture, time)) if controls.beams else (),
            *text,
            controls.help if controls.helps else (),
            controls.selected,
            controls.follows,
        )

    def text(
        self, controls: WindowControls, status: WorldStatus | None, notice: str
    ) -> tuple[str, str, str]:
        """Title, subtitle and notice of the current state."""
        frame = max((view.frame for view in self._views.values()), default=-1)
        subtitle = caption(frame, self._world.dt, status, controls.doing)
        return self._world.world, subtitle, notice
