"""Cases of messages, readings, epochs and names, and messages that must be refused."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import msgpack

from minerva_bus.frame import messages as m
from minerva_bus.wire.codec import FROM_MEMBER, encode, stamp
from minerva_bus.wire.field_codecs import plain_reading
from minerva_bus.wire.keys import is_name
from minerva_bus.wire.plain import pack
from tools import golden_messages as golden
from tools.vectors.notation import Cases, packed_hex, tagged

LONGEST_BYTES: Final = 20_000
"""Longest encoding of a case; longer golden messages are left out."""


def _messages() -> Iterator[tuple[str, m.Message, bytes]]:
    for name, message in golden.MESSAGES.items():
        data = encode(message)
        if len(data) <= LONGEST_BYTES:
            yield name, message, data


def messages() -> Cases:
    """Messages as bytes, and what these are."""
    for name, message, data in _messages():
        plain: Any = msgpack.unpackb(data, ext_hook=msgpack.ExtType)
        sender = "member" if plain[0] in FROM_MEMBER else "coordinator"
        sender = "anyone" if isinstance(message, m.Readings | m.FrameRecord) else sender
        yield name, {"sender": sender, "msgpack": data.hex()}, tagged(plain)


def readings() -> Cases:
    """Readings as bytes, and what these are."""
    for number, reading in enumerate(golden.READINGS):
        plain = plain_reading(reading)
        yield f"{plain[0]} {number}", packed_hex(plain), tagged(plain)


def epochs() -> Cases:
    """A message with the epoch of its coordinator."""
    tick = encode(m.TickRequest(7))
    for epoch in (0, 1, 127, 128, 255, 256, 65535, 65536, 1_700_000_000, 1 << 32, (1 << 63) - 1):
        given = {"epoch": str(epoch), "message": tick.hex()}
        yield str(epoch), given, (stamp(epoch) + tick).hex()


def _refused() -> Iterator[tuple[str, bytes]]:
    reply = encode(m.TickReply("g", 7, golden.EVENTS[:1]))
    yield "nothing", b""
    yield "no list", pack({"ticked": 7})
    yield "an empty list", pack([])
    yield "an unknown message", pack(["tocked", 7])
    yield "cut off", reply[:-1]
    yield "data after the end", reply + b"\xc0"
    yield "a name that is no text", pack([7, 7, [], None])
    yield "too few items", pack(["ticked", 7, []])
    yield "too many items", pack(["ticked", 7, [], None, None])
    yield "a negative frame", pack(["ticked", -1, [], None])
    yield "a frame that is no integer", pack(["ticked", 7.0, [], None])
    yield "a bool as frame", pack(["ticked", True, [], None])
    yield "nil as a value", pack(["ticked", 7, [["eNear", [None]]], None])
    yield "a number that is not finite", pack(["ticked", 7, [["eNear", [float("inf")]]], None])
    yield "a text for a number", pack(["ticked", 7, [["eNear", ["0.5"]]], None])
    yield "an unknown event type", pack(["ticked", 7, [["eFar", [0.5]]], None])
    yield "an event without its data", pack(["ticked", 7, [["eNear", []]], None])
    yield "an event of three items", pack(["ticked", 7, [["eNear", [0.5], ""]], None])
    yield "a condition that is none", pack(["ticked", 7, [["eNear", [0.5], "x <", "", []]], None])
    yield "an invalid id", pack(["ticked", 7, [["eNear", [0.5], "", "", ["a b"]]], None])
    yield "a key that is no text", pack(["ticked", 7, [], {1: 2}])
    yield "text that is not UTF-8", b"\x94\xa6ticked\x07\x90\x81\xa1\xff\x01"
    for name, changed in (
        ("a string that is cut off", [2, ["PStar", [0.5]]]),
        ("a string with data after its end", [0, ["PStar", [0.5]]]),
        ("a symbol that the vocabulary lacks", [1, ["PMoon", [0.5]]]),
        ("a value too few", [1, ["PStar", []]]),
        ("a slot outside a skeleton", [1, ["AFox", "a", None, 0]]),
        ("two agents with one id", [2, ["AStone", "s", [], 0], ["AStone", "s", [], 0]]),
        ("a figure with a scope", [1, ["PStar", [0.5], 0]]),
    ):
        yield name, pack(["evolved", 7, 0, {"a": changed}, {}, {}])


def refused() -> Cases:
    """Messages of members that a reader refuses."""
    for name, data in _refused():
        yield name, data.hex(), "refused"


NAMES: Final = ("a", "A-1", "_x", "0", "a.b~c", "x" * 64, "", "x" * 65, "-a", ".a", "~a", "a b",
                "a/b", "é", "a*", "a$", "a?", "a#")  # fmt: skip


def names() -> Cases:
    """Whether a text can name a world, a member or a topic."""
    for name in NAMES:
        yield name or "empty", name, is_name(name)
