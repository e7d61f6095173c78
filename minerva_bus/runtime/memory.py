"""Freed memory, which a process keeps for its next frame."""

from __future__ import annotations

import ctypes
import os
from functools import cache
from typing import Final

KEPT: Final = 64 * 1024 * 1024
"""Bytes of freed memory that a process does not return to the system."""

LARGEST: Final = 32 * 1024 * 1024
"""Bytes of an allocation from which on the system provides memory for it alone; glibc's maximum."""

_TRIM_THRESHOLD: Final = -1
_MMAP_THRESHOLD: Final = -3
"""Parameters of `mallopt`, in glibc's `malloc.h`."""


@cache
def keep_freed_memory() -> bool:
    """Let this process and its forks reuse freed memory; False if they cannot be told to.

    Each frame allocates the arrays of large populations. By default glibc returns freed arrays to
    the system, which then clears every page again: a quarter of a frame of 100,000 birds. A user
    who has set glibc's own variables is not overruled.
    """
    if any(name.startswith(("MALLOC_", "GLIBC_TUNABLES")) for name in os.environ):
        return False
    # Absent from other C libraries, such as those of macOS and Alpine.
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None) if os.name == "posix" else None
    if mallopt is None:
        return False
    # Both, because setting either one ends glibc's adjustment of the other.
    return bool(mallopt(_MMAP_THRESHOLD, LARGEST) and mallopt(_TRIM_THRESHOLD, KEPT))
