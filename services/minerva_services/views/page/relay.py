"""Relays the batches of a page's WebSocket to the world's endpoint, and back."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING

from minerva_bus.errors import MisuseError
from minerva_bus.runtime.endpoints import check_endpoint
from minerva_services.views.page.guard import BusGuard, ForbiddenMessage

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection

BATCH = 0xFFFF
"""Most bytes of a batch."""

STALL_SECONDS = 0.5
"""Seconds for which a page may take nothing; less than the coordinator would wait for it."""


def check_relayed(endpoint: str) -> None:
    """Raise MisuseError if a page cannot be connected to an endpoint."""
    if not endpoint:
        raise MisuseError("page: pages join over the bus; run without --in-process")
    if check_endpoint(endpoint).kind not in ("tcp", "unixsock-stream"):
        raise MisuseError(f"page: it runs on the world's own machine only, not at {endpoint}")


async def relay(page: ServerConnection, endpoint: str, guard: BusGuard) -> str:
    """Relay until one side closes; returns why the page was cut off, "" if it was not.

    Both transports carry the same batches: a WebSocket as messages, a stream after their lengths.
    """
    try:
        reader, writer = await _open(endpoint)
    except OSError:
        await page.close(1013, "the world does not answer")
        return ""
    try:
        directions = [
            asyncio.create_task(_to_world(page, writer, guard)),
            asyncio.create_task(_to_page(page, reader)),
        ]
        done, pending = await asyncio.wait(directions, return_when=asyncio.FIRST_COMPLETED)
        for task in pending:
            task.cancel()
        await asyncio.gather(*pending, return_exceptions=True)
        reason = next((task.result() for task in directions if task in done and task.result()), "")
    finally:
        writer.close()
    await page.close(1008 if reason else 1000, reason[:120])
    return reason


async def _open(endpoint: str) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    address = check_endpoint(endpoint)
    if address.path:
        return await asyncio.open_unix_connection(address.path)
    return await asyncio.open_connection(address.host, address.port)


async def _to_world(page: ServerConnection, writer: asyncio.StreamWriter, guard: BusGuard) -> str:
    from websockets.exceptions import ConnectionClosed

    try:
        async for batch in page:
            if isinstance(batch, str) or not batch or len(batch) > BATCH:
                return "it sent no batch of Zenoh"
            guard.check(batch)
            writer.write(len(batch).to_bytes(2, "little") + batch)
            await writer.drain()
    except ForbiddenMessage as forbidden:
        return str(forbidden)
    except (ConnectionClosed, OSError):
        pass
    return ""


async def _to_page(page: ServerConnection, reader: asyncio.StreamReader) -> str:
    from websockets.exceptions import ConnectionClosed
    from websockets.protocol import State

    try:
        while True:
            size = int.from_bytes(await reader.readexactly(2), "little")
            batch = await reader.readexactly(size)
            # A page that no longer reads would hold up the coordinator's messages to it.
            async with asyncio.timeout(STALL_SECONDS):
                await page.send(batch)
    except TimeoutError:
        # A link that is closing does not read either, and needs no reason.
        return "it does not read its messages" if page.state is State.OPEN else ""
    except (ConnectionClosed, asyncio.IncompleteReadError, OSError):
        pass
    return ""
