"""The sockets below a session's links.

Zenoh gives no hold on them, but they are this process's own.
"""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false
from __future__ import annotations

import os
import socket
import struct
from collections.abc import Iterator
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import Any, Final

import zenoh
from zenoh.handlers import Callback

_AT_ONCE: Final = struct.pack("ii", 0, 0)
_BEYOND_LEASE: Final = 1.0
"""Seconds without a sign from the other side, beside Zenoh's own lease."""


def sockets_to(address: str) -> Iterator[socket.socket]:
    """The sockets of a link to an address, such as tls/10.0.0.2:7447, each a copy to be used once.

    The newest come first, so that a new link's is found at once among a thousand. There are none
    of links that have no socket of their own (QUIC, sockets in the file system).
    """
    host, _, port = address.partition("/")[2].rpartition(":")
    for connection in _sockets() if port.isdecimal() else ():
        with connection, suppress(OSError):
            if connection.getpeername()[:2] == (host.strip("[]"), int(port)):
                yield connection


def let_dead_links_go(session: zenoh.Session, lease: float) -> None:
    """Let a link of a session that dies be gone soon, and hold up no others.

    `lease`: seconds without a sign after which Zenoh gives up a link.

    Zenoh closes a link when nothing has come for a while, but not before it has written what it
    was about to write, for which the system would try for a quarter of an hour (TCP_USER_TIMEOUT;
    where the system has no such option, it does). And it closes the socket when that was
    delivered, or ten seconds are over (SO_LINGER), while a thread that serves other links as well
    stands still. Without, the system still delivers what it can.
    """
    given_up_after = round(1000 * (lease + _BEYOND_LEASE))

    def new_link(event: Any) -> None:
        if event.kind != zenoh.SampleKind.PUT:
            return
        for one in islice(sockets_to(str(event.link.dst)), 1):
            with suppress(OSError, AttributeError):
                one.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _AT_ONCE)
                one.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, given_up_after)

    session.info.declare_link_events_listener(Callback(new_link, indirect=True), history=True)


def _sockets() -> Iterator[socket.socket]:
    """All sockets of the process, each by a copy of its descriptor; the highest first."""
    for descriptor in sorted(
        (int(entry.name) for entry in Path("/dev/fd").iterdir()), reverse=True
    ):
        try:
            copy = os.dup(descriptor)
        except OSError:
            continue  # The listing itself had it open.
        try:
            yield socket.socket(fileno=copy)
        except OSError:
            os.close(copy)
