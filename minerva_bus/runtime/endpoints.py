"""Endpoints where sessions listen or connect, and checks that they are secured."""

from __future__ import annotations

import errno
import ipaddress
import socket
from dataclasses import dataclass
from typing import Final

from minerva_bus.arguments import text
from minerva_bus.errors import BusError
from minerva_bus.security.credentials import SECURED

_KINDS: Final = ("tcp", *SECURED, "udp", "ws", "unixsock-stream")
_PATH: Final = "unixsock-stream"


@dataclass(frozen=True, slots=True)
class Endpoint:
    """A parsed endpoint; a socket in the file system has a path instead of host and port."""

    text: str
    kind: str
    host: str = ""
    port: int = 0
    path: str = ""

    @property
    def secured(self) -> bool:
        """Whether both sides authenticate with certificates."""
        return self.kind in SECURED

    @property
    def local(self) -> bool:
        """Whether it is reachable from this machine only."""
        if self.path or self.host == "localhost":
            return True
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return False

    @property
    def wildcard(self) -> bool:
        """Whether it stands for all addresses of this machine."""
        return is_wildcard(self.host)

    def at(self, host: str, port: int) -> str:
        """The endpoint of this kind at another address."""
        return f"{self.kind}/{f'[{host}]' if ':' in host else host}:{port}"


def own_endpoint(listen: str, actual: str) -> str:
    """The endpoint for processes of this machine: a loopback address in place of a wildcard.

    `actual` is where the session listens, with its port.
    """
    asked = check_endpoint(listen)
    if not asked.wildcard:
        return actual
    return asked.at(loopback(asked.host), check_endpoint(actual).port)


def for_others(listen: str, own: str) -> str:
    """The endpoint at which a session listens, with the port of its `own_endpoint`."""
    asked = check_endpoint(listen)
    return asked.at(asked.host, check_endpoint(own).port) if asked.wildcard else own


def is_wildcard(host: str) -> bool:
    """Whether a host to listen at stands for all addresses of this machine."""
    try:
        return ipaddress.ip_address(host).is_unspecified
    except ValueError:
        return False


def loopback(wildcard: str) -> str:
    """The address for connections from this machine to a wildcard address."""
    if ":" not in wildcard:
        return "127.0.0.1"
    # [::] takes IPv4, too, and a machine may have IPv6 switched off: then it has no ::1.
    try:
        with socket.socket(socket.AF_INET6, socket.SOCK_STREAM) as probe:
            probe.bind(("::1", 0))
    except OSError:
        return "127.0.0.1"
    return "::1"


def check_endpoint(endpoint: str) -> Endpoint:
    """Parse an endpoint. Raises BusError if it is not one."""
    kind, _, address = text("an endpoint", endpoint).partition("/")
    if kind not in _KINDS or not address:
        raise BusError(
            f"{endpoint!r} is not an endpoint; expected tcp/HOST:PORT, tls/HOST:PORT,"
            " quic/HOST:PORT or unixsock-stream/PATH"
        )
    if kind == _PATH:
        return Endpoint(endpoint, kind, path=address)
    host, _, port = address.rpartition(":")
    if not host or not port.isdecimal() or int(port) > 65535:
        raise BusError(f"{endpoint!r} is not an endpoint; expected {kind}/HOST:PORT")
    return Endpoint(endpoint, kind, host.strip("[]"), int(port))


def check_listening(endpoint: str, *, keys: bool, insecure: bool) -> None:
    """Reject an endpoint at which any process could join a world. Raises BusError."""
    asked = check_endpoint(endpoint)
    if asked.secured and not keys:
        raise BusError(
            f"{endpoint} needs keys: minerva keys init makes them, --keys FOLDER names them"
        )
    if not (asked.secured or asked.local or insecure):
        raise BusError(
            f"{endpoint} would admit anyone who can reach it, with all permissions; create keys"
            f" (minerva keys init) and listen at tls/{asked.host}:{asked.port} with --keys FOLDER,"
            " or insist with --insecure"
        )


def check_port_free(endpoint: Endpoint) -> None:
    """Check that a port is free, because Zenoh's error does not mention a port in use.

    Raises BusError.
    """
    if endpoint.kind not in ("tcp", "tls") or not endpoint.port:
        return
    family = socket.AF_INET6 if ":" in endpoint.host else socket.AF_INET
    with socket.socket(family, socket.SOCK_STREAM) as probe:
        # Without this, a port whose last connections are in TIME_WAIT would seem to be in use.
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((endpoint.host, endpoint.port))
        except (OSError, UnicodeError) as error:
            why = getattr(error, "strerror", None) or error
            raise BusError(
                f"cannot listen at {endpoint.text}: {why}; {_otherwise(error)}"
            ) from None


def _otherwise(error: OSError | UnicodeError) -> str:
    """Advice for a port that is not available."""
    if isinstance(error, socket.gaierror | UnicodeError) or error.errno == errno.EADDRNOTAVAIL:
        return "choose an address of this machine, or 0.0.0.0 for all that it has"
    return "choose another port, or port 0 for any that is free"
