"""Device side of a member: assembles views from keyframes and deltas, and shows them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from minerva_bus.frame import messages as m
from minerva_bus.frame.view_streams import patch_all
from minerva_bus.grammar.scene import Scene
from minerva_bus.user_code import blamed
from minerva_bus.world.services import Device, Service, View


@dataclass(slots=True)
class _Picture:
    """The current view of one visual event type."""

    sequence: int
    skeleton: Scene
    parts: dict[str, Scene]
    halted: frozenset[str] = frozenset()


class DeviceSide:
    """Views of one member by visual event type, and which of them have not been shown."""

    def __init__(self, service: Service | None) -> None:
        self._service = service
        self._pictures: dict[str, _Picture] = {}
        self._unshown: dict[str, int] = {}

    def rejoin(self) -> None:
        """Accept the next keyframes regardless of their sequence number."""
        for picture in self._pictures.values():
            picture.sequence = -1

    def take(self, shown: m.ViewShown) -> bool:
        """Apply a keyframe or a delta; False if a view was missed, so that a keyframe is needed."""
        picture = self._pictures.get(shown.event_type)
        if shown.skeleton is not None:
            # Equal numbers count: a requested keyframe repeats the sequence of the latest view.
            if picture is None or shown.sequence >= picture.sequence:
                picture = _Picture(shown.sequence, shown.skeleton, dict(shown.parts))
                self._pictures[shown.event_type] = picture
                self._changed(shown)
            return True
        # Deltas cannot be applied after a gap; a keyframe replaces all missed views.
        if picture is None or shown.sequence > picture.sequence + 1:
            return False
        # A delta with a lower number is contained in the keyframe that arrived before it.
        if shown.sequence > picture.sequence:
            picture.sequence = shown.sequence
            picture.parts.update(shown.parts)
            patch_all(picture.parts, shown.patches)
            self._changed(shown)
        return True

    def _changed(self, shown: m.ViewShown) -> None:
        self._pictures[shown.event_type].halted = frozenset(shown.halted)
        self._unshown[shown.event_type] = shown.frame

    def show(self, begin: Callable[[int], None]) -> None:
        """Show the pending views on the device; `begin` gets the frame of each view.

        A coupled device shows each view at once. An observer that fell behind shows only the
        latest view of each event type, to catch up.
        """
        if not self._unshown:
            return
        unshown, self._unshown = self._unshown, {}
        for event_type, frame in sorted(unshown.items()):
            begin(frame)
            if isinstance(self._service, Device):
                picture = self._pictures[event_type]
                # A copy, because the device may keep the view, and the next
                # delta changes the parts in place.
                parts = dict(picture.parts)
                view = View(frame, event_type, picture.skeleton, parts, picture.halted)
                with blamed(self._service.show):
                    self._service.show(view)
