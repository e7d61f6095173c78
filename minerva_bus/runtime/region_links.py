"""The session of a region's coordinator for its neighbours: direct links, one key per direction.

It is a second session beside the hub's, so that nothing else of a region reaches another one.
"""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false, reportUnknownLambdaType=false
from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Final, Protocol

import zenoh
from zenoh.handlers import Callback

from minerva_bus.errors import BusError
from minerva_bus.runtime.session import (
    CONNECT_SECONDS,
    brief,
    connecting,
    lease,
    session_config,
)
from minerva_bus.wire.keys import Keys

_THREADS: Final = "(acc:(handover:rx),app:(handover:rx),rx:(worker_threads:1))"


@dataclass(frozen=True, slots=True)
class RegionAppeared:
    """A region receives parcels from now on; those that were sent before may be lost."""

    region: int


@dataclass(frozen=True, slots=True)
class ParcelArrived:
    """A parcel from another region, as bytes."""

    source: int
    data: bytes


class Arrivals(Protocol):
    """A queue for what arrives."""

    def put(self, item: Any) -> None:
        """Add an item; called in threads of Zenoh, which must not wait."""
        ...


class RegionLinks:
    """Links to all other regions of a world.

    `RegionAppeared` and `ParcelArrived` go to the queue `arrivals`.
    """

    def __init__(
        self, keys: Keys, number: int, endpoints: Mapping[int, str], arrivals: Arrivals
    ) -> None:
        """`endpoints` are those of all regions, by number. Raises BusError if it cannot listen."""
        earlier = [endpoint for region, endpoint in sorted(endpoints.items()) if region < number]
        self._arrivals = arrivals
        self._number = number
        # One side of each pair dials: two paths would deliver twice.
        self._session = _open(f"region-{number}", endpoints[number], earlier)
        self._publishers = {
            region: self._session.declare_publisher(
                keys.parcel(number, region),
                congestion_control=zenoh.CongestionControl.BLOCK,
                express=True,
            )
            for region in sorted(endpoints)
            if region != number
        }
        own = Callback(self._arrived, indirect=False)
        self._subscriber = self._session.declare_subscriber(keys.parcel("*", number), own)
        for region, publisher in self._publishers.items():
            linked = Callback(partial(self._matches, region), indirect=False)
            publisher.declare_matching_listener(linked)

    def send(self, region: int, data: bytes) -> None:
        """Send a parcel; it is lost if there is no link to the region."""
        self._publishers[region].put(data)

    def close(self) -> None:
        """Close all links."""
        self._session.close()

    def _arrived(self, sample: zenoh.Sample) -> None:
        source = str(sample.key_expr).rsplit("/", 2)[1]
        if source.isdecimal() and int(source) in self._publishers:
            self._arrivals.put(ParcelArrived(int(source), sample.payload.to_bytes()))

    def _matches(self, region: int, status: zenoh.MatchingStatus) -> None:
        if status.matching:
            self._arrivals.put(RegionAppeared(region))


def _open(name: str, listen: str, others: Sequence[str]) -> zenoh.Session:
    """A session that listens, and tries to reach others until it is closed. Raises BusError."""
    os.environ.setdefault("ZENOH_RUNTIME", _THREADS)
    options = connecting(list(others), CONNECT_SECONDS) | {
        "listen/endpoints": [listen],
        "listen/exit_on_failure": True,
        # Without an end: with 0, a link would never be tried again.
        "connect/timeout_ms": -1,
        "connect/exit_on_failure": False,
        # Microseconds, longer than a lease: messages to a stopped neighbour are lost only together
        # with its link, whose return makes this region send them again.
        "transport/link/tx/queue/congestion_control/block/wait_before_close": (
            round(2_000_000 * lease())
        ),
    }
    try:
        return zenoh.open(session_config("peer", name, options, shared=False, own=None))
    except zenoh.ZError as error:
        raise BusError(f"cannot listen at {listen}: {brief(error)}") from None
