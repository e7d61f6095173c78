"""Checks what a page sends to the bus: only what a member of its name may send.

The relay connects pages with the rights of its own process, which may do everything. So each batch
of Zenoh's protocol is read here, and whatever members/javascript would not send closes the link.
docs/reference/protocol/zenoh-wire.md describes the messages.
"""

from __future__ import annotations

import re
from typing import Final

from minerva_bus.errors import MinervaError
from minerva_bus.wire.keys import COORDINATOR, Keys

_INIT, _OPEN, _KEEP_ALIVE, _CLOSES = 0x41, 0x42, 0x04, (0x03, 0x23)
_FRAME, _FRAGMENTS, _LAST_FRAGMENT = 0x25, (0x26, 0x66), 0x26
_CLIENT: Final = 0x02
_PUSH, _PUT, _QUALITY = 0xBD, 0x01, 0x21
_DECLARE, _SUBSCRIBER, _NO_SUBSCRIBER, _TOKEN, _NO_TOKEN = 0x1E, 0x22, 0x03, 0x26, 0x07
_INTERESTS, _OF_TOKENS = (0x39, 0x79), 0x39


class ForbiddenMessage(MinervaError):
    """A page has sent what it may not send; the text is the reason."""


class _BatchReader:
    """Reads numbers and slices of a batch. Raises ForbiddenMessage at its end."""

    def __init__(self, batch: bytes) -> None:
        self.batch = batch
        self.at = 0

    @property
    def is_empty(self) -> bool:
        return self.at >= len(self.batch)

    def byte(self) -> int:
        if self.is_empty:
            raise ForbiddenMessage("a message is cut off")
        self.at += 1
        return self.batch[self.at - 1]

    def number(self) -> int:
        """A LEB128 of at most nine bytes."""
        value = 0
        for place in range(9):
            byte = self.byte()
            value |= (byte & 0x7F) << (7 * place)
            if byte < 0x80:
                return value
        raise ForbiddenMessage("a number is too long")

    def skip(self, length: int) -> None:
        if length > len(self.batch) - self.at:
            raise ForbiddenMessage("a message is cut off")
        self.at += length

    def key(self) -> str:
        """A key without a mapping."""
        if self.number() != 0:
            raise ForbiddenMessage("a key has a mapping")
        start = self.number()
        self.skip(start)
        try:
            return self.batch[self.at - start : self.at].decode()
        except UnicodeDecodeError:
            raise ForbiddenMessage("a key is not UTF-8") from None


class BusGuard:
    """The rights of one member of a world on the bus, by name."""

    def __init__(self, world: str, member: str) -> None:
        keys = Keys(world)
        part = r"[^/*$?#]+"
        base = re.escape(keys.base)
        self._member = member
        self._puts = re.compile(
            rf"{re.escape(keys.sent_by(member))}|{base}/topic/{part}/{re.escape(member)}"
        )
        self._subscriptions = re.compile(
            rf"{base}/(all|tick|evolve|to/{re.escape(member)}|view/{part}|topic/{part}/\*)"
        )
        self._token = keys.alive(member)
        self._tokens = (self._token, keys.alive(COORDINATOR))
        self._is_in_fragments = False

    def check(self, batch: bytes) -> None:
        """Check a batch. Raises ForbiddenMessage."""
        reader = _BatchReader(batch)
        header = reader.byte()
        if header == _INIT:
            reader.byte()
            if reader.byte() & 0x03 != _CLIENT:
                raise ForbiddenMessage("it is not a client")
        elif header == _FRAME:
            reader.number()
            while not reader.is_empty:
                self._check_message(reader)
        elif header in _FRAGMENTS:
            self._check_fragment(reader, header)
        elif header == _KEEP_ALIVE:
            if not reader.is_empty:
                self.check(batch[1:])
        elif header != _OPEN and header not in _CLOSES:
            raise ForbiddenMessage(f"it sent a transport message {header:#04x}")

    def _check_fragment(self, reader: _BatchReader, header: int) -> None:
        """Only payloads are long; the key is in the first fragment."""
        reader.number()
        if not self._is_in_fragments:
            self._check_head(reader, reader.byte())
        self._is_in_fragments = header != _LAST_FRAGMENT

    def _check_head(self, reader: _BatchReader, header: int) -> None:
        """Check a PUSH up to its payload."""
        if header != _PUSH:
            raise ForbiddenMessage(f"it sent a message {header:#04x}")
        key = reader.key()
        if reader.byte() != _QUALITY:
            raise ForbiddenMessage("a message has unknown extensions")
        reader.number()
        if reader.byte() != _PUT:
            raise ForbiddenMessage("a message is not a plain PUT")
        if not self._puts.fullmatch(key):
            raise ForbiddenMessage(f"{self._member} may not publish on {key[:200]!r}")

    def _check_message(self, reader: _BatchReader) -> None:
        header = reader.byte()
        if header == _DECLARE:
            self._check_declaration(reader)
        elif header in _INTERESTS:
            reader.number()
            if reader.byte() != _OF_TOKENS or reader.key() not in self._tokens:
                raise ForbiddenMessage("it asked for other declarations than tokens")
        else:
            self._check_head(reader, header)
            reader.skip(reader.number())

    def _check_declaration(self, reader: _BatchReader) -> None:
        declared = reader.byte()
        reader.number()
        if declared in (_NO_SUBSCRIBER, _NO_TOKEN):
            return
        key = reader.key() if declared in (_SUBSCRIBER, _TOKEN) else ""
        if declared == _SUBSCRIBER and self._subscriptions.fullmatch(key):
            return
        if declared == _TOKEN and key == self._token:
            return
        raise ForbiddenMessage(f"{self._member} may not declare {key[:200]!r}")
