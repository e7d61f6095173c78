"""A question to a world's coordinator, and its answer."""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false
from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import zenoh

from minerva_bus.errors import BusError
from minerva_bus.security.credentials import Credentials
from minerva_bus.wire.keys import ANY_WORLD, asking_key, control_key
from minerva_bus.wire.plain import as_map, as_text, pack, unpack


def question_key(world: str, own: Credentials | None) -> str:
    """Where one puts questions to a world, by its name; without one, to whichever is there."""
    named = world or ANY_WORLD
    if own is None:
        return control_key(named)
    return control_key(named, own.name) if own.operates else asking_key(named, own.name)


def ask(
    session: zenoh.Session, key: str, question: str, within: float, details: Mapping[str, Any]
) -> Mapping[str, Any] | None:
    """The world's answer to a question, or None where none comes within so many seconds.

    Raises BusError where the world refuses.
    """
    try:
        replies = session.get(key, payload=pack({"ask": question, **details}), timeout=within)
    except zenoh.ZError as error:
        raise BusError(f"the bus cannot be asked any more: {error}") from None
    for reply in replies:
        if reply.ok is not None:
            answer = as_map(unpack(reply.ok.payload.to_bytes()), "an answer")
            if "error" in answer:
                raise BusError(as_text(answer["error"], "an error"))
            return answer
    return None
