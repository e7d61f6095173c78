"""Names and folders of picture files."""

from __future__ import annotations

import os
from pathlib import Path

from minerva_bus.errors import MisuseError


def numbered(path: Path, frame: int) -> Path:
    """`name-000010.svg` for `name.svg` and frame 10."""
    return path.with_name(f"{path.stem}-{frame:06d}{path.suffix}")


def prepare_folder(path: Path) -> None:
    """Create a picture's folder. Raises MisuseError if it is not writable."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise _unwritable(path, error.strerror or "") from None
    if not os.access(path.parent, os.W_OK | os.X_OK):
        raise _unwritable(path, "its folder is not writable")


def _unwritable(path: Path, reason: str) -> MisuseError:
    return MisuseError(f"picture: cannot write {path}: {reason}; set path to a writable file")
