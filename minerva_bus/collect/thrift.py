"""Thrift's compact protocol, in which the footer of a Parquet file is written.

Source: https://github.com/apache/thrift/blob/master/doc/specs/thrift-compact-protocol.md
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

TRUE, FALSE, BYTE, I16, I32, I64, DOUBLE, BINARY, LIST, SET, MAP, STRUCT = range(1, 13)
_LONG: Final = 15
"""Size in the head of a list, if the size follows."""


@dataclass(slots=True)
class Item:
    """A field of a structure: its number, its type, and its value.

    Structures are lists of fields, lists are `Listed`, and a bool is its type.
    """

    number: int
    kind: int
    value: Any


@dataclass(slots=True)
class Listed:
    """A list with the type of its values."""

    kind: int
    values: list[Any]


def decode(data: bytes) -> list[Item]:
    """The structure in these bytes. Raises ValueError for anything else."""
    try:
        return _Decoder(data).structure()
    except (IndexError, RecursionError):
        raise ValueError("not a structure of Thrift") from None


def encode(fields: list[Item]) -> bytes:
    """The bytes of a structure."""
    out = bytearray()
    _put_structure(out, fields)
    return bytes(out)


class _Decoder:
    def __init__(self, data: bytes) -> None:
        self._data = data
        self._at = 0

    def structure(self) -> list[Item]:
        fields: list[Item] = []
        number = 0
        while head := self._byte():
            step, kind = head >> 4, head & 15
            number = number + step if step else self._signed()
            fields.append(Item(number, kind, self._value(kind)))
        return fields

    def _byte(self) -> int:
        self._at += 1
        return self._data[self._at - 1]

    def _unsigned(self) -> int:
        number, shift = 0, 0
        while (byte := self._byte()) & 0x80:
            number |= (byte & 0x7F) << shift
            shift += 7
        return number | byte << shift

    def _signed(self) -> int:
        number = self._unsigned()
        return number >> 1 ^ -(number & 1)

    def _bytes(self, length: int) -> bytes:
        self._at += length
        if self._at > len(self._data):
            raise IndexError
        return self._data[self._at - length : self._at]

    def _value(self, kind: int) -> Any:
        if kind in (TRUE, FALSE):
            return None
        if kind == BYTE:
            return self._byte()
        if kind in (I16, I32, I64):
            return self._signed()
        if kind == DOUBLE:
            return self._bytes(8)
        if kind == BINARY:
            return self._bytes(self._unsigned())
        if kind in (LIST, SET):
            return self._list()
        if kind == STRUCT:
            return self.structure()
        raise ValueError(f"type {kind} of Thrift is not expected here")

    def _list(self) -> Listed:
        head = self._byte()
        size, kind = head >> 4, head & 15
        if size == _LONG:
            size = self._unsigned()
        # In a list, a bool is a byte.
        read = self._byte if kind in (TRUE, FALSE) else lambda: self._value(kind)
        return Listed(kind, [read() for _ in range(size)])


def _put_structure(out: bytearray, fields: list[Item]) -> None:
    before = 0
    for field in fields:
        step = field.number - before
        if 0 < step < 16:
            out.append(step << 4 | field.kind)
        else:
            out.append(field.kind)
            _put_signed(out, field.number)
        _put(out, field.kind, field.value)
        before = field.number
    out.append(0)


def _put_unsigned(out: bytearray, number: int) -> None:
    while number > 0x7F:
        out.append(number & 0x7F | 0x80)
        number >>= 7
    out.append(number)


def _put_signed(out: bytearray, number: int) -> None:
    _put_unsigned(out, number << 1 if number >= 0 else (-number << 1) - 1)


def _put(out: bytearray, kind: int, value: Any) -> None:
    if kind == BYTE:
        out.append(value)
    elif kind in (I16, I32, I64):
        _put_signed(out, value)
    elif kind == DOUBLE:
        out += value
    elif kind == BINARY:
        _put_unsigned(out, len(value))
        out += value
    elif kind in (LIST, SET):
        size = len(value.values)
        out.append(min(size, _LONG) << 4 | value.kind)
        if size >= _LONG:
            _put_unsigned(out, size)
        for item in value.values:
            _put(out, BYTE if value.kind in (TRUE, FALSE) else value.kind, item)
    elif kind == STRUCT:
        _put_structure(out, value)
