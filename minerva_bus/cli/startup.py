"""Start of a run: when the program started, and imports without garbage collection."""

from __future__ import annotations

import gc
import time
from collections.abc import Generator
from contextlib import contextmanager

BEGAN = time.monotonic() - time.process_time()
"""When this program started, on the monotonic clock, seconds.

It is derived from CPU time, because start-up only computes. The age of the process is not a
measure: a shell may have become this process by exec.
"""


@contextmanager
def uncollected() -> Generator[None]:
    """Disable garbage collection during imports, which create almost no garbage."""
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()
