"""The notation of test vectors: see docs/reference/protocol/test-vectors.md."""

from __future__ import annotations

import struct
from collections.abc import Iterable
from typing import Any, TypeAlias

import msgpack

from minerva_bus.wire.plain import pack

Json: TypeAlias = Any
Cases: TypeAlias = Iterable[tuple[str, Json, Json]]
"""The name, input and expected output of each case."""


def bits(number: float) -> str:
    """A float64 as 16 hexadecimal digits, most significant byte first."""
    return struct.pack(">d", number).hex()


def tagged(plain: Any) -> Json:
    """Plain data as JSON that keeps types: see docs/reference/protocol/test-vectors.md."""
    match plain:
        case None | bool() | str():
            return plain
        case int():
            return {"int": str(plain)}
        case float():
            return {"float": bits(plain)}
        case bytes():
            return {"bytes": plain.hex()}
        case msgpack.ExtType():
            return {"ext": plain.code, "bytes": plain.data.hex()}
        case list() | tuple():
            return [tagged(item) for item in plain]
        case dict():
            return {"map": [[key, tagged(value)] for key, value in plain.items()]}
        case _:
            raise TypeError(f"{type(plain).__name__} has no notation")


def packed_hex(plain: Any) -> str:
    """Plain data as MessagePack in hexadecimal."""
    return pack(plain).hex()
