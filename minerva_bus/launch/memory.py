"""Shared memory of sessions: whether there is room for it, and an end of what is left over.

A process that is killed leaves its files behind. Zenoh locks those that are in use, and the lock
ends with the process: a file without one is nobody's.
"""

from __future__ import annotations

import fcntl
import os
import shutil
from collections.abc import Callable
from pathlib import Path

from minerva_bus.grammar.columns import columns_in
from minerva_bus.grammar.scene import Scene

FOLDER = Path("/dev/shm")  # noqa: S108


LARGE = 4 * 1024 * 1024
"""Bytes of columns from which on a world's own processes share memory."""


def prepared(wanted: bool | None, scene: Scene, needed: int, note: Callable[[str], None]) -> bool:
    """Whether a world's processes share memory, once what is left over there is gone.

    They do where every process can have its part of the bytes needed: more would end by a signal.
    `wanted` is what the world file says; None: where the string is large.
    """
    if wanted is False or (wanted is None and column_bytes(scene) < LARGE):
        return False
    sweep()
    shared = has_room(needed)
    if wanted and not shared:
        note(f"no room for {needed >> 20} MB of shared memory; large messages go through sockets")
    return shared


def column_bytes(scene: Scene) -> int:
    """How many bytes the numbers in a string's columns have: what its populations will send."""
    return sum(
        column.array.nbytes
        for piece in columns_in(scene)
        for column in piece.all_columns()
        if column.array.dtype != object
    )


def has_room(needed: int, folder: Path = FOLDER) -> bool:
    """Whether so many bytes of shared memory can be had here."""
    try:
        return shutil.disk_usage(folder).free >= needed
    except OSError:
        return False


def sweep(folder: Path = FOLDER) -> int:
    """Remove the files of sessions that are no more; how many there were."""
    return sum([_removed(path) for path in sorted(folder.glob("*.zenoh"))])


def _removed(path: Path) -> bool:
    try:
        descriptor = os.open(path, os.O_RDWR)
    except OSError:
        return False  # Another's, or just gone.
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        path.unlink()
    except OSError:
        return False
    finally:
        os.close(descriptor)
    return True
