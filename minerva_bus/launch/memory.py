"""Shared memory of sessions: whether there is enough, and removal of orphaned files.

A killed process leaves its files behind. Zenoh locks the files that are in use, and the system
releases a lock when its process ends: a file without a lock is an orphan.
"""

from __future__ import annotations

import fcntl
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Final

from minerva_bus.grammar.columns import columns_in
from minerva_bus.grammar.scene import Scene

FOLDER: Final = Path("/dev/shm")  # noqa: S108
LARGE_BYTES: Final = 4 * 1024 * 1024
"""Size of a string's columns from which the processes of a world share memory by default."""


def prepare(wanted: bool | None, scene: Scene, needed: int, note: Callable[[str], None]) -> bool:
    """Whether the processes of a world share memory, after orphaned files are removed.

    `needed`: bytes for all processes. `wanted` is the setting; None: if the string is large.
    """
    if wanted is False or (wanted is None and column_bytes(scene) < LARGE_BYTES):
        return False
    remove_orphans()
    # A process that writes beyond the free space would be killed by SIGBUS.
    shared = has_room(needed)
    if wanted and not shared:
        note(f"no room for {needed >> 20} MB of shared memory; large messages go through sockets")
    return shared


def column_bytes(scene: Scene) -> int:
    """Bytes of the numbers in a string's columns, which its populations will send."""
    return sum(
        column.array.nbytes
        for piece in columns_in(scene)
        for column in piece.all_columns()
        if column.array.dtype != object
    )


def has_room(needed: int, folder: Path = FOLDER) -> bool:
    """Whether this much shared memory is free, in bytes, and can be written."""
    try:
        # A container may mount it read-only; Zenoh would then not even listen.
        return os.access(folder, os.W_OK) and shutil.disk_usage(folder).free >= needed
    except OSError:
        return False


def remove_orphans(folder: Path = FOLDER) -> int:
    """Remove the files of sessions that have ended; returns their number."""
    return sum([_removed(path) for path in sorted(folder.glob("*.zenoh"))])


def _removed(path: Path) -> bool:
    try:
        descriptor = os.open(path, os.O_RDWR)
    except OSError:
        return False  # It belongs to another user, or has just been removed.
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        path.unlink()
    except OSError:
        return False
    finally:
        os.close(descriptor)
    return True
