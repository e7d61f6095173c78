"""Serving: standard input and output, or streamable HTTP on this machine."""

from __future__ import annotations

import ipaddress
import logging
import os
from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import Any, Final

import anyio
import uvicorn
from mcp.server.stdio import stdio_server
from starlette.datastructures import Headers
from starlette.responses import PlainTextResponse

from minerva_assistants.mcp.server import WorldServer
from minerva_bus.errors import MisuseError
from minerva_bus.launch.child_processes import end_signals
from minerva_services.web_access import WebAccess

PATH: Final = "/mcp"
END_SECONDS: Final = 1.5
MAX_LOGGED: Final = 400
"""Characters of a line of the log: libraries quote what a client has sent."""
POLL_SECONDS: Final = 0.02


class ShortFormatter(logging.Formatter):
    """Makes one line of a problem, without the traceback of code that a client's data reached."""

    def format(self, record: logging.LogRecord) -> str:
        text = record.getMessage()
        if record.exc_info and record.exc_info[1] is not None:
            text += f": {type(record.exc_info[1]).__name__}: {record.exc_info[1]}"
        return " ".join(text.split())[:MAX_LOGGED]


@contextmanager
def short_log() -> Generator[None]:
    """Log what libraries report, in short lines on standard error."""
    handler = logging.StreamHandler()
    handler.setLevel(logging.WARNING)
    handler.setFormatter(ShortFormatter())
    root = logging.getLogger()
    root.addHandler(handler)
    try:
        yield
    finally:
        root.removeHandler(handler)


def serve_stdio(world: WorldServer) -> None:
    """Serve one client at standard input and output, until it closes them or a signal arrives."""
    try:
        anyio.run(_stdio, world)
    except* BrokenPipeError:  # A client that has died reads no more, which is not an error here.
        world.stop()


async def _stdio(world: WorldServer) -> None:
    async with anyio.create_task_group() as tasks:
        tasks.start_soon(_stop_at_signal, world)
        async with stdio_server() as (incoming, outgoing):
            options = world.server.create_initialization_options()
            await world.server.run(incoming, outgoing, options)
        world.stop()
        tasks.cancel_scope.cancel()


async def _stop_at_signal(world: WorldServer) -> None:
    with anyio.open_signal_receiver(*end_signals()) as signals:
        async for number in signals:
            world.stop()
            # Calls in progress end the processes that they have started.
            with anyio.move_on_after(END_SECONDS):
                while world.busy:
                    await anyio.sleep(POLL_SECONDS)
            # The SDK's thread may wait for input for ever, and Python would wait for the thread.
            os._exit(128 + number)


def check_listen(host: str) -> None:
    """Raise MisuseError unless a host is this machine: the server has no authentication."""
    try:
        local = host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        local = False
    if not local:
        raise MisuseError(
            f"--listen {host}: expected 127.0.0.1, ::1 or localhost, because HTTP clients are not"
            " authenticated; for another machine, use stdio over SSH, or a proxy with passwords"
        )


def serve_http(
    world: WorldServer, host: str, port: int, token: str, listening: Callable[[str], None]
) -> None:
    """Serve clients over streamable HTTP until a signal arrives.

    `token` is required of each request; "": none. `listening` is called with the address, which has
    the token. Port 0: a free one.
    """
    access = WebAccess(host, port, token)
    app = _Checked(world.server.streamable_http_app(streamable_http_path=PATH, host=host), access)
    config = uvicorn.Config(
        app,
        host=host,
        port=port,
        log_level="warning",
        log_config=None,
        timeout_graceful_shutdown=1,
    )
    query = f"?token={token}" if token else ""
    _Server(config, world, lambda url: listening(url + query)).run()


class _Checked:
    """An ASGI application that answers only requests that `access` permits."""

    def __init__(self, app: Any, access: WebAccess) -> None:
        self._app = app
        self._access = access

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        if scope["type"] == "http":
            refusal = self._access.refusal(_path(scope), Headers(scope=scope))
            if refusal:
                await PlainTextResponse(f"{refusal}\n", 403)(scope, receive, send)
                return
        await self._app(scope, receive, send)


def _path(scope: Any) -> str:
    return f"{scope['path']}?{scope['query_string'].decode('latin-1')}"


class _Server(uvicorn.Server):
    """Reports its address, and ends the calls in progress with it."""

    def __init__(
        self, config: uvicorn.Config, world: WorldServer, listening: Callable[[str], None]
    ) -> None:
        super().__init__(config)
        self._world = world
        self._listening = listening

    async def startup(self, sockets: Any = None) -> None:
        await super().startup(sockets)
        for server in getattr(self, "servers", []):
            host, port = server.sockets[0].getsockname()[:2]
            shown = f"[{host}]" if ":" in host else host
            self._listening(f"http://{shown}:{port}{PATH}")

    def handle_exit(self, sig: int, frame: Any) -> None:
        self._world.stop()
        super().handle_exit(sig, frame)
