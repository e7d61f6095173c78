"""Connections of browsers: what a browser sends is no error of the world.

viser expects that its own page sends all messages. Programs with the page's token may send others,
and a browser may be of another version.
"""

from __future__ import annotations

import asyncio
import sys
import warnings
from collections.abc import Awaitable, Callable
from typing import Any, TypeAlias

from minerva_bus.errors import ProtocolError, text_of
from minerva_bus.wire.plain import as_bytes, as_map, unpack

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
