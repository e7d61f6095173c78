"""A page's server: on its own port, silent, and with access control."""

from __future__ import annotations

import gzip
import os
import re
import threading
from collections.abc import Collection
from functools import partial
from html import escape
from typing import Any, Final
from weakref import WeakSet

from viser import ViserServer

from minerva_bus.launch.captured_output import printed
from minerva_bus.launch.web_access import WebAccess, token_for
from minerva_services.views.page_access import guarding
from minerva_services.views.page_address import listen, page_url
from minerva_services.views.web.connections import tolerant

_TITLE: Final = re.compile(b"<title>.*?</title>")


class PageServer(ViserServer):
    """A server that is never announced outside, with the access rules of its page."""

    access: WebAccess
    threads: WeakSet[threading.Thread]

    def request_share_url(self, verbose: bool = True) -> str | None:
        """None: pages are only for those who can reach the host."""
        return None


def serve(host: str, port: int, names: Collection[str] = (), title: str = "") -> PageServer:
    """Serve at a host and port; with port 0 at the first free one from 8080.

    `names` are additional host names of the page; `title` is what the browser's tab shows.

    Raises MisuseError if that is impossible.
    """

    def start(chosen: int) -> PageServer | None:
        # The launcher runs as long as the world; a restarted server thus has the same token.
        token = token_for(chosen, str(os.getppid()))
        access = WebAccess(host, chosen, token, frozenset(names))
        # viser prints its address, which lacks the token.
        threads = WeakSet[threading.Thread]()
        with printed(_drop, threads), guarding(access, partial(_entitle, title), tolerant):
            server = PageServer(host=host, port=chosen, verbose=False)
        server.access, server.threads = access, threads
        # viser takes the next port if another process was faster, but the access is for this one.
        if server.get_port() == chosen:
            return server
        stop(server)
        return None

    return listen("web", host, port, start)


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


def stop(server: PageServer) -> None:
    """Stop a server; browsers keep their last picture."""
    with printed(_drop, server.threads):
        server.stop()


def _drop(line: str) -> None:
    """Drop what viser prints."""


def url(server: PageServer) -> str:
    """URL of the page for a browser on this machine, with its token."""
    return page_url(server.access)
