"""MessagePack: each value is decoded from all its encodings, and encoded to one of them."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import msgpack

from minerva_bus.errors import ProtocolError
from minerva_bus.wire.plain import extension, pack, unpack
from tools.acceptance.suite import Result, Suite, judged


def _bytes(text: str) -> bytes:
    return bytes.fromhex(text.replace("-", ""))


def _value(case: Mapping[str, Any]) -> Any:
    """The value of a case, which has its type as a key."""
    if "bignum" in case:  # JSON of JavaScript rounds it
        return int(case["bignum"])
    if "binary" in case:
        return _bytes(case["binary"])
    if "ext" in case:
        code, data = case["ext"]
        return extension(code, _bytes(data))
    if "timestamp" in case:
        return msgpack.Timestamp(*case["timestamp"])  # pyright: ignore
    return next(value for kind, value in case.items() if kind != "msgpack")


def _problems(value: Any, encodings: list[bytes]) -> Iterator[str]:
    for data in encodings:
        try:
            decoded = unpack(data)
        except ProtocolError as error:
            yield f"{data.hex()}: {error}"
            continue
        # Numbers are equal as integers and as floats, but True is no 1.
        if decoded != value or isinstance(decoded, bool) != isinstance(value, bool):
            yield f"{data.hex()} is read as {decoded!r:.60}"
    if (data := pack(value)) not in encodings:
        yield f"it is written as {data.hex()}"


def _results(folder: Path) -> Iterator[Result]:
    groups = json.loads((folder / "msgpack-test-suite.json").read_text(encoding="utf-8"))
    for group, cases in groups.items():
        for case in cases:
            value = _value(case)
            name = f"{group.removesuffix('.yaml')} {value!r:.40}"
            yield judged(name, _problems(value, [_bytes(text) for text in case["msgpack"]]))


MSGPACK = Suite(
    "msgpack",
    "kawanet/msgpack-test-suite",
    "dist",
    "the codec: every value from each of its encodings, and back",
    _results,
)
