"""How a run begins: since when its process is there, and fast."""

from __future__ import annotations

import gc
import time
from collections.abc import Generator
from contextlib import contextmanager

BEGAN = time.monotonic() - time.process_time()
"""When this program began, on the monotonic clock, seconds.

What has happened until here is start-up, which computes. The age of the process is no measure: a
shell that has installed the program may have become this process.
"""


@contextmanager
def uncollected() -> Generator[None]:
    """Leave garbage lying while all is imported and read: of that, next to nothing is any."""
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()
