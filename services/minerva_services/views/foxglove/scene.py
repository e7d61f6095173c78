"""The channels of a live view, and what was last sent on each."""

from __future__ import annotations

import threading
from typing import Final

from foxglove import Context
from foxglove.channels import FrameTransformsChannel, GridChannel, SceneUpdateChannel
from foxglove.messages import (
    FrameTransforms,
    SceneEntityDeletion,
    SceneEntityDeletionType,
    SceneUpdate,
    Timestamp,
)
from foxglove.websocket import ChannelView, Client, ServerListener

from minerva_bus.semantics.picture import Picture, Tiles
from minerva_services.views.floor_parts import Floor, named_floors
from minerva_services.views.foxglove.entities import scene_entities, transforms, wall_entity
from minerva_services.views.foxglove.grids import grid

_NANO: Final = 1_000_000_000


class SubscriptionListener(ServerListener):
    """Sets an event at each new subscription; the server calls it in a thread of its own."""

    def __init__(self, subscribed: threading.Event) -> None:
        self._subscribed = subscribed

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:
        self._subscribed.set()


class SceneChannels:
    """Sends pictures on channels; matrices only when they change or after a new subscription."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._scene = SceneUpdateChannel("/scene", context=context)
        self._walls = SceneUpdateChannel("/walls", context=context)
        self._transforms = FrameTransformsChannel("/tf", context=context)
        self._grids: dict[str, GridChannel] = {}
        self._floors: dict[str, Floor] = {}
        self._entities: frozenset[str] = frozenset()

    def show(self, picture: Picture, time: int) -> None:
        """Send a picture of a world time in nanoseconds."""
        stamp = Timestamp(time // _NANO, time % _NANO)
        floors = named_floors(picture.of(Tiles))
        self._show_grids({n: f for n, f in floors.items() if not f.tiles.form.height}, stamp, time)
        self._show_walls({n: f for n, f in floors.items() if f.tiles.form.height}, stamp, time)
        self._floors = floors
        # Most worlds run without a subscriber most of the time.
        if self._scene.has_sinks():
            self._show_entities(picture, stamp, time)
        if self._transforms.has_sinks():
            placed = FrameTransforms(transforms=transforms(picture, stamp))
            self._transforms.log(placed, log_time=time)

    def forget(self) -> None:
        """Send all matrices with the next picture, for a new subscriber."""
        self._floors = {}

    def _show_entities(self, picture: Picture, stamp: Timestamp, time: int) -> None:
        entities = scene_entities(picture, stamp)
        gone = _deletions(self._entities - entities.keys(), stamp)
        self._entities = frozenset(entities)
        update = SceneUpdate(deletions=gone, entities=list(entities.values()))
        self._scene.log(update, log_time=time)

    def _show_walls(self, floors: dict[str, Floor], stamp: Timestamp, time: int) -> None:
        changed = [wall_entity(n, f.tiles, stamp) for n, f in floors.items() if self._differs(n, f)]
        before = {name for name, floor in self._floors.items() if floor.tiles.form.height}
        gone = _deletions(before - floors.keys(), stamp)
        if changed or gone:
            self._walls.log(SceneUpdate(deletions=gone, entities=changed), log_time=time)

    def _show_grids(self, floors: dict[str, Floor], stamp: Timestamp, time: int) -> None:
        for name in sorted(self._grids.keys() - floors.keys()):
            self._grids.pop(name).close()
        for name, floor in floors.items():
            if name not in self._grids:
                self._grids[name] = GridChannel(name, context=self._context)
            if self._differs(name, floor):
                self._grids[name].log(grid(floor, stamp), log_time=time)

    def _differs(self, name: str, floor: Floor) -> bool:
        before = self._floors.get(name)
        return before is None or not before.is_same(floor)


def _deletions(names: frozenset[str] | set[str], stamp: Timestamp) -> list[SceneEntityDeletion]:
    kind = SceneEntityDeletionType.MatchingId
    return [SceneEntityDeletion(timestamp=stamp, type=kind, id=name) for name in sorted(names)]
