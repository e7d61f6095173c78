"""The latest views of several event types as one picture."""

from __future__ import annotations

from collections.abc import Sequence

from minerva_bus.world.services import View, WorldInfo
from minerva_services.geometry.picture import Lists, Picture, combined, geometry_in_space


class Overlay:
    """Views of the event types `draws`, drawn over each other in this order.

    `space`: as things in three dimensions, for worlds that declare those.
    """

    def __init__(self, world: WorldInfo, draws: Sequence[str], space: bool = False) -> None:
        self._lists = {
            event_type: Lists(world.vocabulary, geometry_in_space(world) if space else None)
            for event_type in draws
        }
        self._views: dict[str, View] = {}

    @property
    def frame(self) -> int:
        """The frame of the newest view; -1 before the first one."""
        return max((view.frame for view in self._views.values()), default=-1)

    @property
    def is_complete(self) -> bool:
        """True if the latest views of all event types are of one frame.

        Other devices may cause further views of some of them. A file contains complete pictures
        only; a display that people watch shows each view at once.
        """
        return {view.frame for view in self._views.values()} == {self.frame} and len(
            self._views
        ) == len(self._lists)

    def add(self, view: View) -> None:
        """Replace the view of its event type."""
        self._views[view.event_type] = view

    def picture(self) -> Picture:
        """The picture of the latest views.

        A single view keeps its picture, by whose identity painters notice that nothing has changed.
        """
        views = [self._views[kind] for kind in self._lists if kind in self._views]
        pictures = [
            self._lists[view.event_type].picture(view.skeleton, view.parts) for view in views
        ]
        return combined(pictures)
