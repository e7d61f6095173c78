"""A serial line, on pyserial (extra `serial`), with errors that a bridge can live with."""

from __future__ import annotations

import time
from contextlib import suppress
from typing import Any, Final

from minerva_bus.errors import MisuseError
from minerva_services.bridging import SourceError

NAP: Final = 0.1
"""Seconds that a read waits for the first byte."""

WRITE_WITHIN: Final = 2.0
MOST: Final = 4096


def check_installed(service: str) -> None:
    """Raises MisuseError where the extra is not installed."""
    try:
        import serial  # noqa: F401  # pyright: ignore[reportUnusedImport]
    except ImportError:
        raise MisuseError(f"{service} needs pyserial: pip install 'minerva-bus[serial]'") from None


class SerialLine:
    """An open line. Its methods raise SourceError when it is lost: pulled out, or hung up."""

    def __init__(self, port: str, device: Any) -> None:
        self.port = port
        self._device = device

    def read(self) -> bytes:
        """What has come; nothing where nothing has come for a tenth of a second."""
        try:
            first = self._device.read(1)
            waiting = min(self._device.in_waiting, MOST) if first else 0
            return bytes(first + self._device.read(waiting)) if waiting else bytes(first)
        except OSError as error:
            raise self._lost(error) from None

    def read_exactly(self, count: int, within: float) -> bytes:
        """So many bytes, or fewer where they have not come in so many seconds."""
        until, found = time.monotonic() + within, b""
        while len(found) < count and time.monotonic() < until:
            try:
                found += self._device.read(count - len(found))
            except OSError as error:
                raise self._lost(error) from None
        return found

    def write(self, data: bytes) -> None:
        """Send bytes."""
        try:
            self._device.write(data)
            self._device.flush()
        except OSError as error:
            raise self._lost(error) from None

    def forget(self) -> None:
        """Drop what has come and was not read."""
        try:
            self._device.reset_input_buffer()
        except OSError as error:
            raise self._lost(error) from None

    def set_dtr(self, on: bool) -> None:
        """Set the line DTR; whatever has no such line, as a pseudo terminal, goes on without."""
        with suppress(OSError):
            self._device.dtr = on

    def close(self) -> None:
        """Let go of it; also where it is lost already."""
        with suppress(OSError):
            self._device.close()

    def _lost(self, error: Exception) -> SourceError:
        return SourceError(f"{self.port} is lost: {_reason(error)}")


def open_line(port: str, baud: int) -> SerialLine:
    """Open a device, such as /dev/ttyUSB0, or socket://HOST:PORT; for ourselves alone.

    Raises SourceError where it is not there, or another process has it.
    """
    import serial

    try:
        device = serial.serial_for_url(
            port, baudrate=baud, timeout=NAP, write_timeout=WRITE_WITHIN, exclusive=True
        )
    except (OSError, ValueError) as error:
        raise SourceError(f"{port} cannot be opened: {_reason(error)}") from None
    return SerialLine(port, device)


def _reason(error: Exception) -> str:
    """What is the matter, in words of people."""
    text = str(error)
    for sign, reason in _REASONS.items():
        if sign in text:
            return reason
    return text


_REASONS: Final = {
    "exclusively lock": "another process uses it",
    "No such file": "it is not there (is it plugged in?)",
    "Permission denied": "permission denied (are you in its group, often dialout?)",
    "Inappropriate ioctl": "it is no serial line",
    "Input/output error": "it was pulled out",
    "returned no data": "it was pulled out, or another process reads it",
}
