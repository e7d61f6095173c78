"""The secured links of the coordinator with the names of their certificates.

Zenoh's access control is fixed when a session opens, and does not check revocation. So each new
link is checked, and all links again when a certificate is revoked. Zenoh cannot close a single
link, but its socket belongs to this process.
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
    """A link with a certificate of this name, from this address."""

    name: str
    address: str

    @property
    def shares_socket(self) -> bool:
        """Whether the link has no socket of its own."""
        return self.address.startswith("quic/")


class Links:
    """The secured links of a session. `notify` is called in threads of Zenoh for each new one."""

    def __init__(self, session: zenoh.Session, notify: Callable[[Linked], None]) -> None:
        self._notify = notify
        self._linked: dict[str, Linked] = {}
        # With history, because links may exist before the listener is declared.
        self._listener: Any = session.info.declare_link_events_listener(
            Callback(self._on_event, indirect=True), history=True
        )

    def close(self) -> None:
        """Stop watching."""
        self._listener.undeclare()

    def _on_event(self, event: Any) -> None:
        name, address = event.link.auth_identifier, str(event.link.dst)
        # A link within this machine has no certificate.
        if name is None:
            return
        if event.kind == zenoh.SampleKind.PUT:
            self._linked[address] = Linked(str(name), address)
            self._notify(self._linked[address])
        else:
            self._linked.pop(address, None)

    def of(self, name: str) -> list[Linked]:
        """The links of a name."""
        # A copy, because threads of Zenoh may add links during the iteration.
        return [linked for linked in list(self._linked.values()) if linked.name == name]


def cut(linked: Linked) -> bool:
    """Shut down a link's socket; False if it has none: it shares one, or has closed."""
    for connection in sockets_to(linked.address):
        with suppress(OSError):
            # Not `close`: this is a copy of Zenoh's descriptor, and
            # closing it would leave the link open.
            connection.shutdown(socket.SHUT_RDWR)
            return True
    return False


@contextmanager
def watched(session: zenoh.Session, notify: Callable[[Linked], None]) -> Generator[Links]:
    """The links of a session, while the context lasts."""
    links = Links(session, notify)
    try:
        yield links
    finally:
        links.close()
