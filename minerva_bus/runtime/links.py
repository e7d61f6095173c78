"""Who is linked to the coordinator by which certificate; links that count no more are cut.

Zenoh's access control is fixed when a session opens, and it asks no list of what was revoked. So
a link is looked at when it comes, and again when the list has changed. Zenoh has no way to close
one, but its socket is this process's own.
"""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false, reportUnknownLambdaType=false
from __future__ import annotations

import socket
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any

import zenoh
from zenoh.handlers import Callback

from minerva_bus.runtime.sockets import sockets_to


@dataclass(frozen=True, slots=True)
class Linked:
    """Somebody has come by a certificate of this name, from this address."""

    name: str
    address: str


class Links:
    """The secured links of a session. `tell` is called from Zenoh's threads for each new one."""

    def __init__(self, session: zenoh.Session, tell: Callable[[Linked], None]) -> None:
        self._tell = tell
        self._linked: dict[str, Linked] = {}
        self._listener: Any = session.info.declare_link_events_listener(
            Callback(self._on_event, indirect=True), history=True
        )

    def close(self) -> None:
        """CheckConnection no more."""
        self._listener.undeclare()

    def _on_event(self, event: Any) -> None:
        name, address = event.link.auth_identifier, str(event.link.dst)
        if name is None:
            return
        if event.kind == zenoh.SampleKind.PUT:
            self._linked[address] = Linked(str(name), address)
            self._tell(self._linked[address])
        else:
            self._linked.pop(address, None)

    def of(self, name: str) -> list[Linked]:
        """The links of a name."""
        return [one for one in list(self._linked.values()) if one.name == name]


def cut(linked: Linked) -> bool:
    """Shut a link's socket; False where there is none of it (QUIC shares one among its links)."""
    for connection in sockets_to(linked.address):
        with suppress(OSError):
            connection.shutdown(socket.SHUT_RDWR)
            return True
    return False


@contextmanager
def watched(session: zenoh.Session, tell: Callable[[Linked], None]) -> Generator[Links]:
    """The links of a session, for as long as it is looked at."""
    links = Links(session, tell)
    try:
        yield links
    finally:
        links.close()
