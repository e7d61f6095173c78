"""A WAV file that grows and is valid at any time.

Python's `wave` can read it, but its writer raises again on deletion after the disk was full, so it
is not used here.
"""

from __future__ import annotations

import contextlib
import struct
import sys
from pathlib import Path

import numpy as np

from minerva_bus.errors import MisuseError
from minerva_bus.files import MARK, check_file
from minerva_services.views.sound.synthesis import Samples

_CHANNELS, _WIDTH, _PCM = 2, 2, 1
_HEADER = struct.Struct("<4sI4s4sIHHIIHH")
_DATA = struct.Struct("<4sI")
_TEXT = MARK.encode() + b"\0"  # 20 bytes; chunks have even lengths
_INFO = struct.pack("<4sI4s4sI", b"LIST", 12 + len(_TEXT), b"INFO", b"ISFT", len(_TEXT)) + _TEXT
"""The program's mark as a LIST chunk of type INFO."""
_MAX_BYTES = 2**32 - 2**16
"""Maximum size in bytes: lengths in a WAV file have 32 bits."""


class WavFile:
    """A 16-bit stereo file.

    Raises MisuseError if it cannot be written.
    """

    def __init__(self, path: Path, rate: int) -> None:
        self.path, self.rate = path, rate
        self._bytes = 0
        self._is_full = False
        self.left_out = 0
        """Samples that were not written, because the file was full."""
        check_file(path, "sound")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            # Unbuffered, so that written samples survive any end of the process.
            self._file = path.open("wb", buffering=0)
            self._put(0, self._header())
        except OSError as error:
            raise self._unwritable(error.strerror or "") from None

    def write(self, block: Samples) -> None:
        """Append samples, then update the header; ignored once the file is full."""
        if self._is_full:
            self.left_out += len(block)
            return
        data = np.rint(np.clip(block, -1.0, 1.0) * 32767).astype("<i2").tobytes()
        if self._bytes + len(data) > _MAX_BYTES:
            self._is_full, self.left_out = True, len(block)
            sys.stderr.write(f"sound: {self.path} is full (4 GiB); further samples are dropped\n")
            return
        try:
            self._put(_DATA_OFFSET + self._bytes, data)
            self._bytes += len(data)
            # After the samples: a process that dies in between leaves a valid, shorter file.
            self._put(0, self._header())
        except OSError as error:
            self._is_full = True
            raise self._unwritable(error.strerror or "") from None

    def close(self) -> None:
        """Close the file."""
        with contextlib.suppress(OSError):
            self._file.close()

    def _put(self, at: int, data: bytes) -> None:
        self._file.seek(at)
        while data:
            # An unbuffered write may be partial.
            data = data[self._file.write(data) :]

    def _header(self) -> bytes:
        frame = _CHANNELS * _WIDTH
        about = 16, _PCM, _CHANNELS, self.rate, self.rate * frame, frame, 8 * _WIDTH
        length = _DATA_OFFSET - 8 + self._bytes
        riff = _HEADER.pack(b"RIFF", length, b"WAVE", b"fmt ", *about)
        return riff + _INFO + _DATA.pack(b"data", self._bytes)

    def _unwritable(self, reason: str) -> MisuseError:
        return MisuseError(
            f"sound: cannot write {self.path}: {reason}; set path to a writable file"
        )


_DATA_OFFSET = _HEADER.size + len(_INFO) + _DATA.size
"""Offset of the first sample in bytes."""


def wav_path(path: str) -> Path:
    """The path of a WAV file. Raises MisuseError for other suffixes."""
    if not path.lower().endswith(".wav") or Path(path).name.lower() == ".wav":
        raise MisuseError(f"sound: path is {path!r}; expected a name that ends in .wav")
    return Path(path)
