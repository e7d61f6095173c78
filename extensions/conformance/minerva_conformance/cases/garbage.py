"""Cases of invalid messages: a member must not answer what it cannot read."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from minerva_bus.frame import messages as m
from minerva_bus.wire.codec import encode
from minerva_bus.wire.plain import pack
from minerva_conformance.case import Case, SendIgnored, Tier
from minerva_conformance.cases.scripts import EVERY_ROLE, HOST
from minerva_conformance.world import MEMBER

_FRAGMENTS: Final = encode(m.Fragments({}))

_ANY: Final[Mapping[str, bytes]] = {
    "reserved byte": b"\xc1",
    "no list": pack({"tick": 3}),
    "empty list": pack([]),
    "unknown message": pack(["tock", 3]),
    "name that is no text": pack([3, 3]),
    "cut off": pack(["stop", "a reason"])[:-3],
    "data after the end": pack(["tick", 3]) + b"\xc0",
    "too few items": pack(["stop"]),
    "too many items": pack(["stop", "a reason", 1]),
    "wrong type": pack(["stop", 7]),
    "negative frame": pack(["tick", -1]),
    "text as frame": pack(["tick", "3"]),
    "invalid UTF-8": b"\x92\xa4stop\xa1\xff",
    "deep nesting": b"\x92\xa4stop" + b"\x91" * 400 + b"\x90",
    "huge length": b"\x92\xa4stop\xdd\xff\xff\xff\xff",
}
_TO_HOSTS: Final[Mapping[str, bytes]] = {
    "unknown symbol": pack(["fragments", {"a": [1, ["AMoon", "a", [], 0]]}, []]),
    "missing value": pack(["fragments", {"a": [1, ["ACounter", "a", [1.0], 0]]}, []]),
    "wrong value": pack(["fragments", {"a": [1, ["ACounter", "a", ["x", "", 0], 0]]}, []]),
    "cut off string": pack(["fragments", {"a": [2, ["ACounter", "a", [1.0, "", 0], 0]]}, []]),
    "not finite": pack(["fragments", {"a": [1, ["ACounter", "a", [float("nan"), "", 0], 0]]}, []]),
    "unknown event": pack(["evolve", 0, [MEMBER], [["eFar", []]], [], 0, []]),
    "unknown fragment": pack(["evolve", 0, [MEMBER], [["eAdd", [1.0]]], [], 0, ["nobody"]]),
    "cut off fragments": _FRAGMENTS[:-1],
}

_REQUIREMENTS: Final[Mapping[str, tuple[str, ...]]] = {"unknown fragment": ("P14.4", "P9.5")}


def _cases(prefix: str, messages: Mapping[str, bytes], roles: tuple[object, ...]) -> list[Case]:
    return [
        Case(
            f"{prefix}.{name}", "does not answer an invalid message",
            _REQUIREMENTS.get(name, ("P14.4",)), Tier.ROBUST,
            [role for role in EVERY_ROLE if role in roles],
            (SendIgnored(f"to/{MEMBER}", data, may_end=True),),
        )
        for name, data in messages.items()
    ]  # fmt: skip


GARBAGE: Final = (*_cases("garbage", _ANY, EVERY_ROLE), *_cases("garbage.host", _TO_HOSTS, HOST))
