"""Marks in files that the program writes, by which a later run recognises them.

A mark is a comment, a text chunk or a tag, depending on the format. In text formats it has a
checksum, so a file that was edited afterwards counts as the user's.
"""

from __future__ import annotations

import os
import re
import struct
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

MARK: Final = "Made by Minerva Bus"

_EDGE: Final = 1 << 16
"""Bytes at the start and the end of a file that are searched for its mark."""


def marked(content: bytes, suffix: str) -> bytes:
    """The content with the program's mark in the format of the file's suffix.

    Content of a format without a place for a mark is returned unchanged.
    """
    add = _MARKERS.get(suffix.lower())
    return add(content) if add else content


def is_own(path: Path) -> bool:
    """Whether a file carries the program's mark and, in a text format, is unchanged."""
    try:
        if path.suffix.lower() in _COMMENTS:
            return _is_unchanged(path.read_bytes())
        with path.open("rb") as file:
            # A format determines where its mark is: near the start of a PNG or PGM, at the end of a
            # PDF or GIF.
            edges = file.read(_EDGE)
            file.seek(max(0, os.fstat(file.fileno()).st_size - _EDGE))
            edges += file.read()
    except OSError:
        return False
    # Under another name, such as that of a link, it would be destroyed as a video or a table.
    is_named_record = path.suffix.lower() == ".mcap"
    return MARK.encode() in edges or (is_named_record and _is_record(edges))


def _is_record(head: bytes) -> bool:
    """Whether a file begins as an MCAP file whose header names this library."""
    return head.startswith(b"\x89MCAP") and b"minerva-bus" in head[:256]


_COMMENTS: Final[Mapping[str, tuple[str, str]]] = {
    ".svg": ("<!-- ", " -->"),
    ".html": ("<!-- ", " -->"),
    ".yaml": ("# ", ""),
    ".toml": ("# ", ""),
    ".mnv": ("// ", ""),
    ".mmd": ("%% ", ""),
}
"""Start and end of a comment in text formats."""

_LAST_LINE: Final = re.compile(
    rb"(?:<!--|#|//|%%) " + MARK.encode() + rb", checksum ([0-9a-f]{8})(?: -->)?\n\Z"
)


def _commented(suffix: str) -> Callable[[bytes], bytes]:
    begin, end = _COMMENTS[suffix]

    def add(content: bytes) -> bytes:
        text = content if content.endswith(b"\n") else content + b"\n"
        mark = f"{begin}{MARK}, checksum {zlib.crc32(text):08x}{end}\n"
        return text + mark.encode()

    return add


def _is_unchanged(content: bytes) -> bool:
    # The mark must be the last line, so a file to which a user has added lines does not match.
    mark = _LAST_LINE.search(content[-200:])
    if mark is None:
        return False
    line = len(mark.group(0))
    return f"{zlib.crc32(content[:-line]):08x}".encode() == mark.group(1)


_PNG_HEADER: Final = 33
"""Bytes of the signature and the first chunk, IHDR."""


def _png_chunk(content: bytes) -> bytes:
    """A PNG with a text chunk after its header (PNG specification, 11.3.3.2, keyword Software)."""
    chunk = b"tEXtSoftware\0" + MARK.encode()
    # The length counts the data without the type, the CRC covers both.
    framed = struct.pack(">I", len(chunk) - 4) + chunk + struct.pack(">I", zlib.crc32(chunk))
    return content[:_PNG_HEADER] + framed + content[_PNG_HEADER:]


def _pgm_comment(content: bytes) -> bytes:
    """A PGM with a comment line after its magic number."""
    return content[:3] + f"# {MARK}\n".encode() + content[3:]


def _pdf_comment(content: bytes) -> bytes:
    return content + f"% {MARK}\n".encode()


def gif_comment(content: bytes) -> bytes:
    """A GIF with a comment extension before its trailer (GIF89a, section 24)."""
    text = MARK.encode()
    return content[:-1] + b"\x21\xfe" + bytes([len(text)]) + text + b"\0" + content[-1:]


_MARKERS: Final[Mapping[str, Callable[[bytes], bytes]]] = {
    **{suffix: _commented(suffix) for suffix in _COMMENTS},
    ".png": _png_chunk,
    ".pgm": _pgm_comment,
    ".pdf": _pdf_comment,
    ".gif": gif_comment,
}
