"""What the coordinator says: one publisher for each key."""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false
from __future__ import annotations

from typing import Any

import zenoh
from zenoh.handlers import Callback

from minerva_bus.frame import stimuli as s
from minerva_bus.wire.epochs import stamp
from minerva_bus.wire.keys import Keys

_DROP = zenoh.CongestionControl.DROP
_BLOCK = zenoh.CongestionControl.BLOCK


class Outbox:
    """Speaks to those in a world, as its coordinator of an epoch.

    What goes to members waits for room on the way; views and frames for observers are dropped
    where there is none. `observed`: whether somebody observes the frames.
    """

    def __init__(self, keys: Keys, epoch: int) -> None:
        self.stamp = stamp(epoch)
        self.observed = False
        self._keys = keys
        self._publishers: dict[tuple[str, bool], zenoh.Publisher] = {}
        self._keys_to = {
            s.EVERYONE: keys.all,
            s.TICKED: keys.tick,
            s.HOSTS: keys.evolve,
        }

    def open(self, session: zenoh.Session) -> list[Any]:
        """Begin to speak on a session; what is to be undeclared at the end."""
        self._session = session
        record = self._publisher(self._keys.record, _DROP)
        return [record.declare_matching_listener(Callback(self._on_observers, indirect=False))]

    def send(self, to: str, data: bytes) -> None:
        """Send a message to a member, or to all of a kind."""
        key = self._keys_to.get(to)
        if key is None:
            key = self._keys_to[to] = self._keys.to(to)
        self._publisher(key, _BLOCK).put(self.stamp + data)

    def show(self, event_type: str, data: bytes, to: str = "") -> None:
        """Show a view to all who draw it, or to one of them."""
        key = self._keys.to(to) if to else self._keys.view(event_type)
        self._publisher(key, _DROP).put(self.stamp + data)

    def record(self, data: bytes) -> None:
        """Tell observers of a frame."""
        self._publisher(self._keys.record, _DROP).put(data)

    def _publisher(self, key: str, control: zenoh.CongestionControl) -> zenoh.Publisher:
        drops = control == _DROP
        publisher = self._publishers.get((key, drops))
        if publisher is None:
            publisher = self._session.declare_publisher(key, congestion_control=control)
            self._publishers[key, drops] = publisher
        return publisher

    def _on_observers(self, status: zenoh.MatchingStatus) -> None:
        self.observed = status.matching
