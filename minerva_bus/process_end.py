"""The end of a process of Minerva Bus whose threads are those of Zenoh, too.

While it ends, Python stops each thread where that next needs the interpreter. In a callback of
Zenoh, or in a call of it that another thread makes, this unwinds compiled code, which aborts the
process ("FATAL: exception not rethrown"), or blocks it for ever. No order of closing avoids that,
because an attempt to connect cannot be interrupted. So a process that has opened a session ends
without that step, after all else: its threads, exit handlers and output.
"""

from __future__ import annotations

import atexit
import os
import sys
from collections.abc import Generator
from contextlib import contextmanager

_sessions = False


def session_opened() -> None:
    """Note that this process has threads of Zenoh from now on."""
    global _sessions
    _sessions = True


@contextmanager
def ended_by_system() -> Generator[None]:
    """Run the block; then, if it has opened a session, the process ends without stopping threads.

    It ends with the exit code of the block, as soon as Python has called all later exit handlers.
    """
    code = [0]
    # Exit handlers are called in the reverse order.
    atexit.register(_end, code)
    try:
        yield
    except SystemExit as ended:
        number = ended.code
        code[0] = number if isinstance(number, int) else int(number is not None)
        raise
    except BaseException:
        code[0] = 1
        raise


def _end(code: list[int]) -> None:
    if not _sessions:
        return
    try:
        for stream in (sys.stdout, sys.stderr):
            if stream is not None:
                stream.flush()
    except (OSError, ValueError):
        return  # Python reports it.
    os._exit(code[0] & 0xFF)
