"""Serving: standard input and output, or streamable HTTP on this machine."""

from __future__ import annotations

import ipaddress
import os
from collections.abc import Callable
from typing import Any, Final

import anyio
import uvicorn
from mcp.server.stdio import stdio_server

from minerva_bus.errors import MisuseError
from minerva_bus.launch.interrupts import end_signals
from minerva_bus.mcp.server import WorldServer

PATH: Final = "/mcp"
END_SECONDS: Final = 1.5
POLL_SECONDS: Final = 0.02


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


def serve_http(world: WorldServer, host: str, port: int, listening: Callable[[str], None]) -> None:
    """Serve clients over streamable HTTP until a signal arrives.

    `listening` is called with the address. Port 0: a free one.
    """
    # Host and Origin are checked, so that pages of other sites cannot call tools.
    app = world.server.streamable_http_app(streamable_http_path=PATH, host=host)
    config = uvicorn.Config(
        app, host=host, port=port, log_level="warning", timeout_graceful_shutdown=1
    )
    _Server(config, world, listening).run()


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
