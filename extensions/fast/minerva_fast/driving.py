"""Compiled loops: one over the rows of a rule or table, in several threads if rows are independent.

A kernel `run(begin, end, ...)` returns the place of the first row that has not run: it stops early
if a table has too little room for newborns, and after long loops, so that Ctrl-C works.
"""

from __future__ import annotations

import inspect
import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from functools import cache
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_fast.draws import PLACE, interpreting, new_progress
from minerva_fast.machine_code import load_kernel

PURPOSE: Final = "rules of a space"
"""What needs numba, in messages."""


class Loop:
    """A function of `places` over the rows of a table, compiled when it first runs."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self.name = function.__name__
        self._function = function
        given = ", ".join(inspect.signature(function).parameters)
        self._text = (
            "from minerva_fast.library import *\n\n"
            f"function, signature = loop({self.name!r})\n\n"
            "@kernel(signature)\n"
            f"def run({given}):\n    return function({given})\n"
        )

    def __call__(self, *arguments: Any) -> Any:
        """Run it, compiled or, within `interpreted`, as Python. Raises MisuseError."""
        run = self._function if interpreting() else load_kernel(self._text, PURPOSE)
        return run(*arguments)

    def prepare(self) -> None:
        """Compile it now, unless it is to run as Python. Raises MisuseError."""
        if not interpreting():
            load_kernel(self._text, PURPOSE)


THREADS: Final = "MINERVA_THREADS"
"""The environment variable with the most threads of a rule; by default one for each core."""
_LOCK: Final = threading.Lock()
_ROWS: Final = 8192
"""Fewer rows take less time than a thread takes to start."""


Part: TypeAlias = Callable[[int, int, int, NDArray[np.int64]], None]
"""Runs the rows of a part from a begin to an end; `progress`, the last, has the current one."""


def parts_of(rows: int) -> int:
    """The number of threads for this many rows."""
    enough = rows // _ROWS
    return min(_most(), enough) if enough > 1 else 1


def run_parts(run: Part, rows: int, parts: int) -> tuple[int, Exception] | None:
    """Run all rows in parts, each in a thread; the first row that failed, and its error."""
    borders = [rows * part // parts for part in range(parts + 1)]

    def run_part(part: int) -> tuple[int, Exception] | None:
        progress = new_progress()
        try:
            run(part, borders[part], borders[part + 1], progress)
        except Exception as error:
            return int(progress[PLACE]), error
        return None

    # This thread takes the first part, so a rule in two threads wakes one.
    with _LOCK:
        others = [_threads().submit(run_part, part) for part in range(1, parts)]
    try:
        first = run_part(0)
    finally:  # also if a person interrupts it: the others write to the same arrays
        wait(others)
    failures = [first, *[other.result() for other in others]]
    return next((failed for failed in failures if failed is not None), None)


@cache
def _threads() -> ThreadPoolExecutor:
    """The threads of this process, kept since each start of a pool takes 0.2 ms of CPU time."""
    return ThreadPoolExecutor(max(1, _most() - 1), "minerva-rule")


def _end_threads() -> None:
    """End the threads: a process that is forked from this one would not have them."""
    with _LOCK:
        if _threads.cache_info().currsize:
            _threads().shutdown()
            _threads.cache_clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_end_threads)


def _most() -> int:
    limit = os.environ.get(THREADS, "")
    if limit.isdecimal() and int(limit):
        return int(limit)
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
