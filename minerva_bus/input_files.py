"""Input files that are read as a whole: regular files up to a size.

A name may belong to any file, by mistake or by intent. A pipe would be opened when something writes
to it, a device may have no end, and a sparse file takes no space but more memory than there is.
"""

from __future__ import annotations

import errno
from pathlib import Path
from typing import Final

from minerva_bus.outputs import is_stream

MAX_BYTES: Final = 64 << 20


def read_bytes(path: Path, most: int = MAX_BYTES) -> bytes:
    """Contents of a file of at most `most` bytes.

    Raises OSError with the reason in `strerror`, also for larger files, pipes and devices, and
    ValueError if the name contains a null character.
    """
    check_input(path, most)
    return path.read_bytes()


def read_text(path: Path, most: int = MAX_BYTES) -> str:
    """Text of a file of at most `most` bytes, in UTF-8 with or without a byte order mark.

    Raises OSError and ValueError as `read_bytes` does, and UnicodeDecodeError.
    """
    return read_bytes(path, most).decode("utf-8-sig")


def check_input(path: Path, most: int = MAX_BYTES) -> None:
    """Raise OSError if this is not a regular file, or one of more than `most` bytes."""
    size = path.stat().st_size
    if path.is_dir():
        raise OSError(errno.EISDIR, "a folder; expected a file")
    if is_stream(path):
        raise OSError(errno.EINVAL, "a pipe or device; expected a file")
    if size > most:
        raise OSError(errno.EFBIG, f"has {size:,} bytes; expected at most {most:,}")
