"""The sockets of a session's links. Zenoh has no access to them, but the process does."""

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
"""Seconds that the system keeps trying to deliver, beyond Zenoh's own lease."""


def sockets_to(address: str) -> Iterator[socket.socket]:
    """Copies of the sockets of a link to an address such as tls/10.0.0.2:7447, newest first.

    Newest first, so that a new link's socket is the first of a thousand. Links without a socket of
    their own (QUIC, sockets in the file system) have none. Each copy is closed before the next one
    is returned.
    """
    host, _, port = address.partition("/")[2].rpartition(":")
    for connection in _sockets() if port.isdecimal() else ():
        with connection, suppress(OSError):
            if connection.getpeername()[:2] == (host.strip("[]"), int(port)):
                yield connection


def let_dead_links_go(session: zenoh.Session, lease: float) -> None:
    """Make dead links of a session disappear soon, without a delay of other links.

    Zenoh closes a link after `lease` seconds without a message, but only after a pending write,
    which the system would retry for a quarter of an hour: TCP_USER_TIMEOUT shortens this, where it
    exists. Closing then blocks for up to ten seconds, until the rest is delivered, in a thread that
    serves other links: SO_LINGER of zero prevents that; the system still delivers what it can.
    """
    give_up_milliseconds = round(1000 * (lease + _BEYOND_LEASE))

    def new_link(event: Any) -> None:
        if event.kind != zenoh.SampleKind.PUT:
            return
        # The first match is the new link. Comparing all sockets would take quadratic time
        # in a world of a thousand members.
        for connection in islice(sockets_to(str(event.link.dst)), 1):
            with suppress(OSError, AttributeError):
                connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _AT_ONCE)
                connection.setsockopt(
                    socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, give_up_milliseconds
                )

    session.info.declare_link_events_listener(Callback(new_link, indirect=True), history=True)


def _sockets() -> Iterator[socket.socket]:
    """Copies of all sockets of the process, the highest descriptor first."""
    for descriptor in sorted(
        (int(entry.name) for entry in Path("/dev/fd").iterdir()), reverse=True
    ):
        try:
            # A socket object closes its descriptor, so it gets a
            # copy: the original belongs to Zenoh.
            copy = os.dup(descriptor)
        except OSError:
            continue  # The descriptor of the directory listing itself.
        try:
            yield socket.socket(fileno=copy)
        except OSError:
            os.close(copy)
