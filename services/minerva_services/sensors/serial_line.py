"""A serial line, using pyserial (extra `serial`), with errors that bridges can handle."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache
from typing import Any, Final

from minerva_services.bridging import SourceError

POLL_SECONDS: Final = 0.1
"""Time-out in seconds of a read for its first byte."""

WRITE_SECONDS: Final = 2.0
MAX_BYTES: Final = 4096


class SerialLine:
    """An open line. Its methods raise SourceError when it is lost: unplugged or disconnected."""

    def __init__(self, port: str, device: Any) -> None:
        self.port = port
        self._device = device

    def read(self) -> bytes:
        """Available bytes; empty if none arrive within a tenth of a second."""
        data = b""
        try:
            # Waits for one byte only: read(n) would wait for all n, or for the time-out.
            data = bytes(self._device.read(1))
            waiting = min(self._device.in_waiting, MAX_BYTES) if data else 0
            return data + bytes(self._device.read(waiting)) if waiting else data
        except OSError as error:
            # The next call reports the loss, after the bytes before it.
            if data:
                return data
            raise self._lost(error) from None

    def read_exactly(self, count: int, within: float) -> bytes:
        """Up to `count` bytes; fewer on time-out."""
        until, data = time.monotonic() + within, b""
        while len(data) < count and time.monotonic() < until:
            try:
                data += self._device.read(count - len(data))
            except OSError as error:
                raise self._lost(error) from None
        return data

    def write(self, data: bytes) -> None:
        """Send bytes."""
        try:
            self._device.write(data)
            self._device.flush()
        except OSError as error:
            raise self._lost(error) from None

    def forget(self) -> None:
        """Discard unread input."""
        try:
            self._device.reset_input_buffer()
        except OSError as error:
            raise self._lost(error) from None

    def set_dtr(self, on: bool) -> None:
        """Set DTR; devices without this signal, such as pseudo terminals, are tolerated."""
        with suppress(OSError):
            self._device.dtr = on

    def close(self) -> None:
        """Close the line; also after it is lost."""
        with suppress(OSError):
            self._device.close()

    def _lost(self, error: Exception) -> SourceError:
        return SourceError(f"{self.port} is lost: {_reason(error)}")


def open_line(port: str, baud: int) -> SerialLine:
    """Open a device, such as /dev/ttyUSB0, or socket://HOST:PORT, exclusively.

    Raises SourceError if it is missing or used by another process.
    """
    import serial

    try:
        if port.startswith("socket://"):
            device: Any = _socket_class()(port, timeout=POLL_SECONDS, write_timeout=WRITE_SECONDS)
        else:
            # Exclusive, because two readers would each receive a part of the bytes.
            device = serial.serial_for_url(
                port,
                baudrate=baud,
                timeout=POLL_SECONDS,
                write_timeout=WRITE_SECONDS,
                exclusive=True,
            )
    except (OSError, ValueError) as error:
        raise SourceError(f"cannot open {port}: {_reason(error)}") from None
    return SerialLine(port, device)


@cache
def _socket_class() -> Any:
    """pyserial's class for sockets, without its loss of data."""
    from serial.urlhandler import protocol_socket

    base: Any = protocol_socket.Serial

    class Socket(base):
        def open(self) -> None:
            self._opening = True
            super().open()
            self._opening = False

        def reset_input_buffer(self) -> None:
            # On opening, pyserial discards old input. A socket has none: a server may send at once.
            if not self._opening:
                super().reset_input_buffer()

        @property
        def in_waiting(self) -> int:
            # pyserial answers 1 for any number of bytes, and for the end of the connection.
            try:
                return len(self._socket.recv(MAX_BYTES, socket.MSG_PEEK))
            except BlockingIOError:
                return 0

    return Socket


def _reason(error: Exception) -> str:
    """A short explanation of an error."""
    text = str(error)
    for sign, reason in _REASONS.items():
        if sign in text:
            return reason
    return text


_REASONS: Final = {
    "exclusively lock": "another process uses it",
    "No such file": "no such device (is it plugged in?)",
    "Permission denied": "permission denied (is the user in its group, often dialout?)",
    "Inappropriate ioctl": "not a serial line",
    "Input/output error": "unplugged",
    "returned no data": "unplugged, or another process reads it",
}


class LineSplitter:
    """Splits a byte stream into complete lines without their terminators.

    A line longer than `longest` bytes is dropped and counted as garbage.
    """

    def __init__(self, count: Callable[[str], None], longest: int = MAX_BYTES) -> None:
        self._count = count
        self._longest = longest
        self._rest = b""

    def feed(self, data: bytes) -> Iterator[str]:
        """Complete non-empty lines; non-ASCII bytes become replacement characters."""
        # Devices end lines by CR, LF or both; CR LF leaves an empty line, which is dropped below.
        *whole, self._rest = (self._rest + data).replace(b"\r", b"\n").split(b"\n")
        # Garbage without line ends must not grow without limit.
        if len(self._rest) > self._longest:
            self._rest = b""
            self._count("garbage")
        for line in whole:
            if line.strip():
                yield line.decode("ascii", "replace").strip()

    def rest(self) -> Iterator[str]:
        """The last line of a stream that has ended without a terminator."""
        return self.feed(b"\n")
