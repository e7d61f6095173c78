"""Errors of the reader of bags in words of its user, with the tool that repairs the file."""

from __future__ import annotations

from pathlib import Path
from typing import Final

_CUT: Final = (
    "ord() expected",
    "Truncated record",
    "File end magic",
    "MCAP footer",
    "summary offset",
    "unpack requires",
    "not enough values",
    "Got only",
    "Could not read",
    "could not be read",
    "not indexed",
)
"""Parts of messages about the end of a file."""

_DAMAGED: Final = (
    "Chunk checksum",
    "Chunk size",
    "Unexpected record",
    "Invalid message record",
    "Invalid chunk record",
    "exceeds its chunk",
    "Field size",
    "field size",
    "field could not be parsed",
    "is unexpected",
    "Expected to find",
    "index looks damaged",
    "malformed",
    "not a database",
    "missing tables",
    "too large to convert",
    "cannot fit",
    "decompress",
    "invalid header",
)
"""Parts of messages about what a file contains."""

_OTHER: Final = {
    "File magic": "it is a file of another kind",
    "seems to be empty": "it is empty",
    "Profile is not ros2": "an MCAP of another profile; expected ros2",
    "Expected metadata file": "the folder has no metadata.yaml; create it with: ros2 bag reindex",
    "not in timestamp order": "its messages are not in order; sort them with: mcap sort",
}
"""Meanings of other messages, by a part of them."""

_TOOLS: Final = {
    ".mcap": "repair it with: mcap recover {0} -o repaired.mcap",
    ".bag": "rebuild the index with: rosbag reindex {0}",
    ".db3": "repair it with: sqlite3 {0} .recover | sqlite3 repaired.db3",
}
_FOLDER_TOOL: Final = "rebuild the index with: ros2 bag reindex {0}"

_SURPRISES: Final = (AssertionError, MemoryError, OverflowError)
"""Errors of the reader itself about impossible contents."""

_LONGEST: Final = 120


def reason_of(error: Exception, path: Path) -> str:
    """Why a bag, or a part of it, cannot be read."""
    # Bytes that should be text; the exception would show all of them.
    text = "invalid header" if isinstance(error, UnicodeError) else " ".join(str(error).split())
    shown = text[:_LONGEST].rstrip(".") or type(error).__name__
    tool = _TOOLS.get(path.suffix, _FOLDER_TOOL).format(path.name)
    for part, meaning in _OTHER.items():
        if part in text:
            return meaning
    if any(part in text for part in _CUT):
        return f"it ends too early, as if its recorder had been killed; {tool}"
    if isinstance(error, _SURPRISES) or any(part in text for part in _DAMAGED):
        return f"it is damaged: {shown}; {tool}"
    return shown
