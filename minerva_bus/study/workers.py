"""How many runs go on at a time."""

from __future__ import annotations

import os


def how_many(wanted: int) -> int:
    """So many as wanted; for 0, one for each core that this process may use."""
    return wanted or len(os.sched_getaffinity(0))
