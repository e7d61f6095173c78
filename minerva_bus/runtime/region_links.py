"""The session of a region's coordinator for its neighbours: direct links, one key per direction.

It is a second session beside the hub's, so that nothing else of a region reaches another one.
"""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false, reportUnknownLambdaType=false
from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Final, Protocol

import zenoh
from zenoh.handlers import Callback

from minerva_bus.errors import BusError
from minerva_bus.runtime.endpoints import check_endpoint
from minerva_bus.runtime.session import (
    CONNECT_SECONDS,
    brief,
    close_aside,
    connecting,
    lease,
    listening_at,
    open_session,
    session_config,
)
from minerva_bus.security.access import region_access
from minerva_bus.security.credentials import Credentials
from minerva_bus.wire.keys import Keys, name_of_region

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

    `RegionAppeared` and `ParcelArrived` go to the queue `arrivals`. `endpoint` is where other
    regions reach this one.
    """

    def __init__(
        self,
        keys: Keys,
        number: int,
        endpoints: Mapping[int, str],
        arrivals: Arrivals,
        *,
        count: int = 0,
        own: Credentials | None = None,
    ) -> None:
        """`endpoints` are the known ones by number, its own included, of `count` regions or all.

        With credentials, links need certificates, and a region may only send its own parcels.
        Raises BusError if it cannot listen.
        """
        known = [endpoint for region, endpoint in sorted(endpoints.items()) if region < number]
        self._arrivals, self._keys, self._number, self._own = arrivals, keys, number, own
        self._others = [each for each in range(count or len(endpoints)) if each != number]
        self._publishers: dict[int, zenoh.Publisher] = {}
        self._dialled: dict[int, tuple[str, zenoh.Session]] = {}
        self._linked: set[int] = set()
        # One side of each pair dials: two paths would deliver twice.
        self._session = self._open([_bound(endpoints[number])], known)
        at = listening_at(self._session, endpoints[number], "peer")
        self.endpoint = _announced(endpoints[number], at)
        self._declare(self._session, self._others)

    def dial(self, region: int, endpoint: str) -> None:
        """Link to a region with a lower number at an endpoint, instead of a former one."""
        former = self._dialled.get(region)
        if region >= self._number or (former is not None and former[0] == endpoint):
            return
        session = self._open([], [endpoint])
        self._dialled[region] = endpoint, session
        self._declare(session, [region])
        if former is not None:
            close_aside(former[1])

    def unlinked(self, region: int) -> str:
        """The endpoint of a region that was dialled and has no link; otherwise an empty string."""
        endpoint, _ = self._dialled.get(region, ("", None))
        return "" if region in self._linked else endpoint

    def send(self, region: int, data: bytes) -> None:
        """Send a parcel; it is lost if there is no link to the region."""
        self._publishers[region].put(data)

    def close(self) -> None:
        """Close all links."""
        for _, session in self._dialled.values():
            close_aside(session)
        self._session.close()

    def _declare(self, session: zenoh.Session, regions: Iterable[int]) -> None:
        """Send parcels for these regions, and receive theirs, by the links of a session."""
        for region in regions:
            self._publishers[region] = session.declare_publisher(
                self._keys.parcel(self._number, region),
                congestion_control=zenoh.CongestionControl.BLOCK,
                express=True,
            )
        own = Callback(self._arrived, indirect=False)
        session.declare_subscriber(self._keys.parcel("*", self._number), own)
        for region in regions:
            publisher = self._publishers[region]
            linked = Callback(partial(self._matches, region, publisher), indirect=False)
            publisher.declare_matching_listener(linked)

    def _arrived(self, sample: zenoh.Sample) -> None:
        source = str(sample.key_expr).rsplit("/", 2)[1]
        if source.isdecimal() and int(source) in self._publishers:
            self._arrivals.put(ParcelArrived(int(source), sample.payload.to_bytes()))

    def _matches(
        self, region: int, publisher: zenoh.Publisher, status: zenoh.MatchingStatus
    ) -> None:
        if publisher is not self._publishers[region]:
            return  # Of a former link.
        if not status.matching:
            self._linked.discard(region)
        else:
            self._linked.add(region)
            self._arrivals.put(RegionAppeared(region))

    def _open(self, listen: Sequence[str], others: Sequence[str]) -> zenoh.Session:
        """A session that listens, and tries to reach others until it is closed. Raises BusError."""
        os.environ.setdefault("ZENOH_RUNTIME", _THREADS)
        options = connecting(list(others), CONNECT_SECONDS) | {
            "listen/endpoints": list(listen),
            "listen/exit_on_failure": True,
            # Without an end: with 0, a link would never be tried again.
            "connect/timeout_ms": -1,
            "connect/exit_on_failure": False,
            # Microseconds, longer than a lease: messages to a stopped neighbour are lost only
            # together with its link, whose return makes this region send them again.
            "transport/link/tx/queue/congestion_control/block/wait_before_close": (
                round(2_000_000 * lease())
            ),
        }
        if self._own is not None:
            options["access_control"] = region_access(self._keys, self._number, self._others)
        name = name_of_region(self._number)
        try:
            config = session_config("peer", name, options, shared=False, own=self._own)
            return open_session(config)
        except zenoh.ZError as error:
            where = ", ".join([*listen, *others])
            raise BusError(f"cannot link regions at {where}: {brief(error)}") from None


def _bound(listen: str) -> str:
    """Where to listen: a name stands for all addresses, which it may not have in a container."""
    asked = check_endpoint(listen)
    if asked.path or asked.host[:1].isdigit() or ":" in asked.host:
        return listen
    return f"{asked.kind}/0.0.0.0:{asked.port}"


def _announced(listen: str, actual: str) -> str:
    """The endpoint for other regions: as given, with the actual port instead of 0."""
    return listen if not listen.endswith(":0") else f"{listen[:-1]}{check_endpoint(actual).port}"
