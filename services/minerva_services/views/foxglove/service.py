"""The Foxglove device: a server of Foxglove's protocol, behind a port that checks connections.

The SDK's own server checks none, so it listens at a hidden address, and the port passes on what is
permitted.
"""

from __future__ import annotations

import asyncio
import errno
import io
import secrets
import sys
import threading
from collections.abc import Mapping
from contextlib import closing, suppress
from http.client import HTTPException, parse_headers
from typing import TYPE_CHECKING, Final

from minerva_bus.errors import MisuseError
from minerva_bus.world.services import Device, View, WorldInfo
from minerva_services.options import check_port, check_rate, event_types, names_in, require
from minerva_services.views.overlay import Overlay
from minerva_services.views.page_access import announce, listen
from minerva_services.web_access import WebAccess

if TYPE_CHECKING:
    from foxglove.websocket import WebSocketServer

    from minerva_services.views.foxglove.scene import SceneChannels


FIRST_PORT = 8765
"""The port that Foxglove proposes when it opens a connection."""
_NANO = 1_000_000_000


_ORIGINS = ("https://app.foxglove.dev", "file://")
"""Pages of Foxglove itself; the programs for desktops send a file's origin."""


def _hidden_host() -> str:
    """An address of this machine that pages of other sites cannot find by trying."""
    if sys.platform != "linux":  # Others have one address for loopback only.
        return "127.0.0.1"
    return ".".join(["127", *[str(1 + secrets.randbelow(254)) for _ in range(3)]])


class Foxglove(Device, draws=("ePicture",)):
    """Serves every world whose vocabulary declares forms to Foxglove, Lichtblick and other clients.

    Clients only read: they can neither send events nor pause the world.

    Args:
        host: the address to listen at; 0.0.0.0 accepts connections from other machines, and whoever
            connects sees the world.
        port: the port; 0: the first free one from 8765.
        origins: further sites whose pages may connect, comma-separated, such as
            http://localhost:8080 of an own Lichtblick.
        rate: maximum views per second.
        draws: visual event types, comma-separated; their views are drawn over each other in this
            order.

    Raises MisuseError if foxglove-sdk is not installed and for invalid options.

    """

    interactive = True
    # So that a client that connects to a paused world receives a picture.
    pulse_every = 0.2

    def __init__(
        self,
        host: str = "127.0.0.1",
        port: int = 0,
        rate: float = 15.0,
        draws: str = "ePicture",
        origins: str = "",
    ) -> None:
        require("foxglove", "foxglove", "foxglove-sdk", "foxglove")
        check_port("foxglove", port)
        check_rate("foxglove", rate)
        self.when = f"at {rate:g} Hz"
        self.draws = event_types("foxglove", draws)
        self._address = host, port
        self._origins = frozenset((*_ORIGINS, *names_in(origins)))
        self._subscribed = threading.Event()
        self._server: WebSocketServer | None = None
        self._port: CheckedPort | None = None
        self._views = 0

    def joined(self, world: WorldInfo) -> None:
        # Imported here because a view that is only checked need not load it.
        import foxglove

        from minerva_services.views.foxglove.scene import SceneChannels, SubscriptionListener

        self._dt = world.dt
        self._overlay = Overlay(world, self.draws, space=True)
        context = foxglove.Context()
        self._scene: SceneChannels = SceneChannels(context)
        host, wanted = self._address

        inner = _hidden_host()
        try:
            self._server = server = foxglove.start_server(
                name=world.world,
                host=inner,
                port=0,
                capabilities=[foxglove.Capability.Time],
                server_listener=SubscriptionListener(self._subscribed),
                context=context,
            )
        except Exception as error:  # the library raises RuntimeError or its own class
            raise MisuseError(f"foxglove: cannot start its server: {error}") from None

        def start(port: int) -> CheckedPort | None:
            try:
                access = WebAccess(host, port, origins=self._origins)
                return CheckedPort(access, inner, server.port)
            except OSError as error:
                if error.errno == errno.EADDRINUSE:
                    return None
                raise MisuseError(f"foxglove: cannot listen at {host}:{port}: {error}") from None

        try:
            self._port = listen("foxglove", host, wanted, start, FIRST_PORT)
        except MisuseError:
            self.close()
            raise
        announce(world, f"ws://{host}:{self._port.port}")

    def show(self, view: View) -> None:
        self._overlay.add(view)
        self._views += 1
        self._send()

    def pulse(self) -> None:
        if self._subscribed.is_set():
            self._send()

    def report(self) -> Mapping[str, bool | int | float | str]:
        return {"foxglove_views": self._views}

    def close(self) -> None:
        if self._port is not None:
            self._port.stop()
            self._port = None
        if self._server is not None:
            self._server.stop()
            self._server = None

    def _send(self) -> None:
        if self._server is None or self._overlay.frame < 0:
            return
        if self._subscribed.is_set():
            self._subscribed.clear()
            self._scene.forget()
        time = round(self._overlay.frame * self._dt * _NANO)
        self._server.broadcast_time(time)
        self._scene.show(self._overlay.picture(), time)


_MAX_HEAD: Final = 1 << 14
_HEAD_SECONDS: Final = 10.0
_BLOCK: Final = 1 << 16
_START_SECONDS: Final = 10.0


class CheckedPort:
    """Listens where `access` says, and passes connections on to a server at `host` and `port`.

    Raises OSError if the port cannot be opened.
    """

    def __init__(self, access: WebAccess, host: str, port: int) -> None:
        self.port = access.port
        self._access = access
        self._inner = host, port
        self._loop = asyncio.new_event_loop()
        self._over = asyncio.Event()
        self._ready = threading.Event()
        self._failure: OSError | None = None
        self._thread = threading.Thread(target=self._run, name="foxglove", daemon=True)
        self._thread.start()
        self._ready.wait(_START_SECONDS)
        if self._failure is not None:
            raise self._failure

    def stop(self) -> None:
        """Close the port and all connections."""
        self._loop.call_soon_threadsafe(self._over.set)
        self._thread.join(_START_SECONDS)

    def _run(self) -> None:
        with closing(self._loop):
            try:
                self._loop.run_until_complete(self._listen())
            except OSError as error:
                self._failure = error
            finally:
                self._ready.set()

    async def _listen(self) -> None:
        accepted: set[asyncio.Task[None]] = set()

        def accept(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            task = self._loop.create_task(self._connect(reader, writer))
            accepted.add(task)
            task.add_done_callback(accepted.discard)

        access = self._access
        server = await asyncio.start_server(accept, access.host, access.port, limit=_MAX_HEAD)
        self._ready.set()
        await self._over.wait()
        server.close()
        for task in accepted:
            task.cancel()
        await asyncio.gather(*accepted, return_exceptions=True)

    async def _connect(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with closing(writer), suppress(OSError, EOFError, asyncio.LimitOverrunError, HTTPException):
            async with asyncio.timeout(_HEAD_SECONDS):
                head = await reader.readuntil(b"\r\n\r\n")
            request, _, rest = head.partition(b"\r\n")
            path = request.decode("latin-1").partition(" ")[2].rpartition(" ")[0]
            refusal = self._access.refusal(path, parse_headers(io.BytesIO(rest)))
            if refusal:
                writer.write(_forbidden(refusal))
                await writer.drain()
                return
            inner_reader, inner_writer = await asyncio.open_connection(*self._inner)
            with closing(inner_writer):
                inner_writer.write(head)
                directions = [
                    asyncio.create_task(_pass_on(reader, inner_writer)),
                    asyncio.create_task(_pass_on(inner_reader, writer)),
                ]
                try:
                    await asyncio.wait(directions, return_when=asyncio.FIRST_COMPLETED)
                finally:
                    for task in directions:
                        task.cancel()
                    await asyncio.gather(*directions, return_exceptions=True)


async def _pass_on(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    while data := await reader.read(_BLOCK):
        writer.write(data)
        await writer.drain()


def _forbidden(reason: str) -> bytes:
    body = f"{reason}\n".encode()
    lines = (
        "HTTP/1.1 403 Forbidden",
        "Content-Type: text/plain; charset=utf-8",
        f"Content-Length: {len(body)}",
        "Connection: close",
    )
    return "".join([f"{line}\r\n" for line in (*lines, "")]).encode() + body
