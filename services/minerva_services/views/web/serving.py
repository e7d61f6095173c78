"""A page's server: on its own port, silent, and with access control."""

from __future__ import annotations

import errno
import gzip
import io
import re
import socket
from collections.abc import Collection
from contextlib import closing, redirect_stdout
from functools import partial
from html import escape
from typing import Any, Final

from viser import ViserServer

from minerva_bus.errors import MisuseError
from minerva_services.views.web.access import PageAccess, guarding, token_for

FIRST_PORT = 8080
_PORTS = 1000
_TITLE: Final = re.compile(b"<title>.*?</title>")


class PageServer(ViserServer):
    """A server that is never announced outside, with the access rules of its page."""

    access: PageAccess

    def request_share_url(self, verbose: bool = True) -> str | None:
        """None: pages are only for those who can reach the host."""
        return None


def serve(host: str, port: int, names: Collection[str] = (), title: str = "") -> PageServer:
    """Serve at a host and port; with port 0 at the first free one from 8080.

    `names` are additional host names of the page; `title` is what the browser's tab shows.

    Raises MisuseError if that is impossible.
    """
    chosen = port if port and _free(host, port) else 0
    if port and not chosen:
        raise MisuseError(
            f"web: port {port} of {host} is in use; use another one, or 0 for the next free one"
        )
    ports = range(FIRST_PORT, FIRST_PORT + _PORTS)
    chosen = chosen or next((candidate for candidate in ports if _free(host, candidate)), 0)
    if not chosen:
        raise MisuseError(f"web: no port of {host} from {FIRST_PORT} is free; set port")
    access = PageAccess(host, chosen, token_for(chosen), frozenset(names))
    # viser prints its address, which lacks the token.
    with redirect_stdout(io.StringIO()), guarding(access, partial(_entitle, title)):
        server = PageServer(host=host, port=chosen, verbose=False)
    server.access = access
    return server


def _entitle(title: str, response: Any) -> None:
    """Replace the title of a page, which is viser's."""
    if not title or not response.headers.get("Content-Type", "").startswith("text/html"):
        return
    packed = response.headers.get("Content-Encoding") == "gzip"
    page = gzip.decompress(response.body) if packed else response.body
    page = _TITLE.sub(f"<title>{escape(title)}</title>".encode(), page, count=1)
    response.body = gzip.compress(page, compresslevel=1) if packed else page
    del response.headers["Content-Length"]
    response.headers["Content-Length"] = str(len(response.body))


def stop(server: ViserServer) -> None:
    """Stop a server; browsers keep their last picture."""
    with redirect_stdout(io.StringIO()):
        server.stop()


def _free(host: str, port: int) -> bool:
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
            f"web: cannot listen at {host}:{port}: {error.strerror}; expected an address of this"
            " machine, such as 127.0.0.1, or 0.0.0.0 for all"
        ) from None
    return True


def url(server: PageServer) -> str:
    """URL of the page for a browser on this machine, with its token."""
    host = server.get_host()
    shown = {"0.0.0.0": "127.0.0.1", "::": "[::1]"}.get(host, host)  # noqa: S104
    return f"http://{shown}:{server.get_port()}/?token={server.access.token}"
