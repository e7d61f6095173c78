"""The web server of the page, and the connections of browsers.

viser expects that its own page sends all messages. Programs with the page's token may send others,
and a browser may be of another version; what a browser sends is no error of the world.
"""

from __future__ import annotations

import asyncio
import gzip
import os
import re
import sys
import threading
import warnings
from collections.abc import Awaitable, Callable, Collection
from functools import partial
from html import escape
from typing import Any, Final, TypeAlias

from viser import ViserServer

from minerva_bus.errors import ProtocolError, text_of
from minerva_bus.launch.console import printed
from minerva_bus.wire.plain import as_bytes, as_map, unpack
from minerva_services.views.page_access import guarding, listen, page_url
from minerva_services.web_access import WebAccess, token_for

_TITLE: Final = re.compile(b"<title>.*?</title>")
_CODE: Final = b"td.decode(heap.subarray(up+ss,up+sz))"
_WHOLE_NAMES: Final = (
    rb'.replace(/(dirtyGroups\.size>0&&\(\w+\(performance\.now\(\)\+)\w+/,"$1 1e3")'
)
"""Appended to viser's code: all new letters of labels are drawn in one picture.

viser draws letters for 5 ms in each picture, and no label before its last letter. Without a
graphics card a picture takes up to seconds, so names came long after the rest of the world.
"""
_STYLE: Final = b"""<style>.mantine-Notification-description { display: none; }
@media (max-width: 36em) {
  div[style*="flex-grow: 1"][style*="background-color"] { height: 55% !important; flex-grow: 0; }
  .mantine-Paper-root[style*="max-height: 60%"] {
    width: 100% !important; max-height: 45% !important;
    div[style*="width: 20em"] { width: 100% !important; }
  }
}</style></head>"""
"""viser's notifications cover the world, so they have titles only. On a phone, its sheet of
controls would do so, too: here it lies below.
"""


class PageServer(ViserServer):
    """A server that is never announced outside, with the access rules of its page."""

    access: WebAccess

    @property
    def thread(self) -> threading.Thread | None:
        """The thread that serves."""
        return self._websock_server._server_thread  # pyright: ignore[reportPrivateUsage]

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
        with printed(_drop), guarding(access, partial(_adapt, title), tolerant):
            server = PageServer(host=host, port=chosen, verbose=False)
        server.access = access
        # viser takes the next port if another process was faster, but the access is for this one.
        if server.get_port() == chosen:
            return server
        stop(server)
        return None

    return listen("web", host, port, start)


def _adapt(title: str, response: Any) -> None:
    """Replace the title of a page, which is viser's, and adapt its style and its code."""
    if not response.headers.get("Content-Type", "").startswith("text/html"):
        return
    packed = response.headers.get("Content-Encoding") == "gzip"
    page = gzip.decompress(response.body) if packed else response.body
    if title:
        page = _TITLE.sub(f"<title>{escape(title)}</title>".encode(), page, count=1)
    page = page.replace(b"</head>", _STYLE, 1).replace(_CODE, _CODE + _WHOLE_NAMES, 1)
    response.body = gzip.compress(page, compresslevel=1) if packed else page
    del response.headers["Content-Length"]
    response.headers["Content-Length"] = str(len(response.body))


def stop(server: PageServer) -> None:
    """Stop a server; browsers keep their last picture."""
    # Its thread, too, prints that it stops.
    with printed(_drop, (server.thread,)):
        server.stop()


def _drop(line: str) -> None:
    """Drop what viser prints."""


def url(server: PageServer) -> str:
    """URL of the page for a browser on this machine, with its token."""
    return page_url(server.access)


Handler: TypeAlias = Callable[[Any], Awaitable[None]]
"""What takes part in a connection until it is closed."""
_POLICY_VIOLATION = 1008


def tolerant(handler: Handler) -> Handler:
    """A handler that closes the connection of a wrong message, with one line in the log."""

    async def handle(connection: Any) -> None:
        # viser handles most messages in tasks of the loop, which only this server uses.
        asyncio.get_running_loop().set_exception_handler(_log_ignored)
        receive = connection.recv

        async def recv() -> Any:
            data = await receive()
            _check(data)
            return data

        connection.recv = recv
        try:
            await handler(connection)
        except Exception as error:
            _log(f"closed the connection of {_address(connection)}", error)
            await connection.close(_POLICY_VIOLATION, "this message is none of the page")

    # viser warns of a value of a wrong type, and then takes it.
    warnings.filterwarnings("ignore", r"\[viser\] .* does not match annotation")
    return handle


def _check(data: Any) -> None:
    """Raise ProtocolError for a message that would change controls other than by their value.

    viser sets any attribute of a control that a browser names, also its callbacks.
    """
    message = as_map(unpack(as_bytes(data, "a message")), "a message")
    if message.get("type") == "GuiUpdateMessage":
        updates = as_map(message.get("updates"), "updates")
        if set(updates) != {"value"}:
            raise ProtocolError("a browser may change the value of a control only")


def _log_ignored(_: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    error = context.get("exception")
    _log("ignored a message of a browser", error or RuntimeError(context["message"]))


def _log(what: str, error: BaseException) -> None:
    name = type(error).__name__
    text = " ".join(text_of(error).split())[:100]
    sys.stderr.write(f"{what}: the page sends no such message ({name}{': ' * bool(text)}{text})\n")


def _address(connection: Any) -> str:
    peer: Any = connection.remote_address
    return str(peer[0]) if peer else "a browser"
