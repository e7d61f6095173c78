"""Where a page listens, the URL that opens it, and who may open it."""

from __future__ import annotations

import errno
import logging
import socket
import sys
import threading
from collections.abc import Awaitable, Callable, Generator
from contextlib import closing, contextmanager, suppress
from typing import Any, TypeVar

from minerva_bus.errors import MinervaError, MisuseError
from minerva_bus.frame.world_state import Phase
from minerva_bus.runtime.endpoints import is_wildcard, loopback
from minerva_bus.world.services import WorldInfo
from minerva_services.web_access import WebAccess


def silent_logger(name: str) -> logging.Logger:
    """A logger for a server of pages, whose clients' errors are not errors of the world."""
    quiet = logging.getLogger(name)
    quiet.setLevel(logging.CRITICAL)
    return quiet


# The wrapped function belongs to the whole process.
_patching = threading.Lock()


@contextmanager
def guarding(
    access: WebAccess,
    change: Callable[[Any], None],
    around: Callable[[Callable[[Any], Awaitable[None]]], Callable[[Any], Awaitable[None]]],
) -> Generator[None]:
    """While active, servers that start answer only requests that `access` permits.

    `change` is called with each answer and may change it; `around` returns what handles a
    connection instead of the server's own function.

    viser has no hook for access checks, so the function that it serves with is wrapped.
    """
    from websockets.asyncio import server as sockets

    original: Any = sockets.serve
    quiet = silent_logger("minerva.web")

    def serve(handler: Any, *given: Any, process_request: Any, **options: Any) -> Any:
        checked = _checked(access, process_request, change)
        options["logger"] = quiet
        return original(around(handler), *given, process_request=checked, **options)

    with _patching:
        sockets.serve = serve  # pyright: ignore[reportAttributeAccessIssue]
        try:
            yield
        finally:
            sockets.serve = original


def _checked(
    access: WebAccess, answer: Callable[[Any, Any], Any], change: Callable[[Any], None]
) -> Callable[[Any, Any], Any]:
    from websockets import Headers
    from websockets.http11 import Response

    def process(connection: Any, request: Any) -> Any:
        refusal = access.refusal(request.path, request.headers)
        if refusal:
            headers = Headers({"Content-Type": "text/plain; charset=utf-8"})
            return Response(403, "Forbidden", headers, f"{refusal}\n".encode())
        response = answer(connection, request)
        if response is not None:
            change(response)
            response.headers["Set-Cookie"] = access.cookie
            # The address contains the token, which must not reach other sites.
            response.headers["Referrer-Policy"] = "no-referrer"
            # A foreign page must not show this one in a frame and lure its user to click there.
            response.headers["X-Frame-Options"] = "DENY"
        return response

    return process


def announce(world: WorldInfo, *lines: str) -> None:
    """Print where a page is, unless its world on the bus has ended before the page was ready."""
    if world.endpoint:
        with suppress(MinervaError):
            if world.operator.status().phase == Phase.STOPPING.value:
                return
    sys.stdout.write("".join(f"{line}\n" for line in lines))
    sys.stdout.flush()


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
