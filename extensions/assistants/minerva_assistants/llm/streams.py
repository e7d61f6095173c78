"""Server-sent events of a chat completion, put together to a reply as without streaming."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterable, AsyncIterator
from typing import Any, Final, cast

from minerva_assistants.llm.backends import Unavailable

MAX_BYTES: Final = 4 << 20
"""Largest reply of a server or a program; a longer one is rejected."""

END: Final = "[DONE]"


async def limited(chunks: AsyncIterable[bytes]) -> bytes:
    """All chunks in one. Raises Unavailable if they are more than MAX_BYTES."""
    content = bytearray()
    async for chunk in chunks:
        content += chunk
        if len(content) > MAX_BYTES:
            raise Unavailable(f"more than {MAX_BYTES >> 20} MiB")
    return bytes(content)


async def streamed_reply(chunks: AsyncIterable[bytes], limit: asyncio.Timeout) -> dict[str, Any]:
    """The JSON object of a reply from its pieces; the first one ends the time `limit`.

    A server that does not stream sends the object itself. Raises Unavailable if the stream is cut
    off, has no JSON, or reports an error.
    """
    pieces: list[str] = []
    usage: Any = None
    async for data in _data(chunks):
        if data == END:
            return {"choices": [{"message": {"content": "".join(pieces)}}], "usage": usage}
        event = _object(data)
        if "error" in event:
            raise Unavailable(f"the stream reports {json.dumps(event['error'])[:200]}")
        usage = event.get("usage") or usage
        piece = _piece(event)
        if isinstance(piece, str) and piece:
            pieces.append(piece)
            limit.reschedule(None)
        elif _is_whole(event):
            return event
    raise Unavailable("the stream has been cut off")


async def _data(chunks: AsyncIterable[bytes]) -> AsyncIterator[str]:
    """The data of each event; a line that is not an event is data, too."""
    rest, size = b"", 0
    async for chunk in chunks:
        size += len(chunk)
        if size > MAX_BYTES:
            raise Unavailable(f"more than {MAX_BYTES >> 20} MiB")
        *lines, rest = (rest + chunk).split(b"\n")
        for line in lines:
            if (data := _data_of(line)) is not None:
                yield data
    if (data := _data_of(rest)) is not None:
        yield data


def _data_of(line: bytes) -> str | None:
    text = line.decode(errors="replace").strip()
    if text.startswith("data:"):
        return text.removeprefix("data:").strip()
    return text if text.startswith("{") else None


def _object(data: str) -> dict[str, Any]:
    try:
        event = json.loads(data)
    except (ValueError, RecursionError):
        raise Unavailable(f"no JSON in the stream: {data[:60]!r}") from None
    return cast("dict[str, Any]", event) if isinstance(event, dict) else {}


def _is_whole(event: dict[str, Any]) -> bool:
    """Whether it is the reply of a server that does not stream."""
    try:
        return "message" in event["choices"][0]
    except (KeyError, IndexError, TypeError):
        return False


def _piece(event: dict[str, Any]) -> Any:
    try:
        return event["choices"][0]["delta"]["content"]
    except (KeyError, IndexError, TypeError):
        return None
