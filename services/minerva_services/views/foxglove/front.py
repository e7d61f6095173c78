"""A port that passes on only permitted connections, because the SDK's server checks none."""

from __future__ import annotations

import asyncio
import io
import threading
from contextlib import closing, suppress
from http.client import HTTPException, parse_headers
from typing import Final

from minerva_bus.launch.web_access import WebAccess

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
