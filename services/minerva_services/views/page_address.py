"""Addresses of pages: a free port, and the URLs that open a page."""

from __future__ import annotations

import errno
import socket
from collections.abc import Callable
from contextlib import closing
from typing import TypeVar

from minerva_bus.errors import MisuseError
from minerva_bus.launch.web_access import WebAccess
from minerva_bus.runtime.endpoints import is_wildcard, loopback

_Server = TypeVar("_Server")

FIRST_PORT = 8080
_PORTS = 1000


def listen(
    service: str,
    host: str,
    port: int,
    start: Callable[[int], _Server | None],
    first: int = FIRST_PORT,
) -> _Server:
    """A server at a port, or for 0 at the first free one of the host from `first`.

    `start` returns a server at a port that was free; None if another process was faster.

    Raises MisuseError if the port is in use or the host is not an address of this machine.
    """
    for candidate in (port,) if port else range(first, first + _PORTS):
        if _is_free(service, host, candidate):
            server = start(candidate)
            if server is not None:
                return server
    if port:
        raise MisuseError(
            f"{service}: port {port} of {host} is in use; use another one, or 0 for the next"
            " free one"
        )
    raise MisuseError(f"{service}: no port of {host} from {first} is free; set port")


def _is_free(service: str, host: str, port: int) -> bool:
    """True if the port is free.

    Raises MisuseError if the host is not an address of this machine.
    """
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        with closing(socket.socket(family)) as tried:
            # As servers do: otherwise a port with recently closed connections would count as in
            # use.
            tried.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            tried.bind((host, port))
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            return False
        raise MisuseError(
            f"{service}: cannot listen at {host}:{port}: {error.strerror}; expected an address of"
            " this machine, such as 127.0.0.1, or 0.0.0.0 for all"
        ) from None
    return True


def page_url(access: WebAccess, host: str = "") -> str:
    """URL of a page with its token, for a browser on this machine unless `host` is given."""
    shown = host or (loopback(access.host) if is_wildcard(access.host) else access.host)
    shown = f"[{shown}]" if ":" in shown else shown
    scheme = "https" if access.encrypted else "http"
    return f"{scheme}://{shown}:{access.port}/?token={access.token}"


def address_in_network() -> str:
    """The address under which other machines of the network reach this one; "" without any."""
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as probe:
        try:
            # A datagram socket sends nothing by connecting; the system only chooses the interface.
            probe.connect(("192.0.2.1", 9))
            return str(probe.getsockname()[0])
        except OSError:
            return ""
