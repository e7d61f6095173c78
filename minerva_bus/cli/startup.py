"""How a run begins: since when its process is there, and fast."""

from __future__ import annotations

import gc
import os
import time
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path


def _process_began() -> float:
    """When this process was started, on the monotonic clock; now, where the system won't say."""
    try:
        ticks = int(Path("/proc/self/stat").read_text().rpartition(")")[2].split()[19])
        age = time.clock_gettime(time.CLOCK_BOOTTIME) - ticks / os.sysconf("SC_CLK_TCK")
    except (OSError, ValueError, AttributeError, IndexError):
        age = 0.0
    return time.monotonic() - age


BEGAN = _process_began()
"""When this process was started, on the monotonic clock, seconds."""


@contextmanager
def uncollected() -> Generator[None]:
    """Leave garbage lying while all is imported and read: of that, next to nothing is any."""
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()
