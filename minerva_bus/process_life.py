"""The start and the end of a process of the command line, whose threads are those of Zenoh, too.

While it ends, Python stops each thread where that next needs the interpreter. In a callback of
Zenoh, or in a call of it that another thread makes, this unwinds compiled code, which aborts the
process ("FATAL: exception not rethrown"), or blocks it for ever. No order of closing avoids that,
because an attempt to connect cannot be interrupted. So a process that has opened a session ends
without that step, after all else: its threads, exit handlers and output.
"""

from __future__ import annotations

import atexit
import gc
import os
import sys
import threading
import time
from collections.abc import Generator
from contextlib import contextmanager
from typing import Final

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


SAID_SECONDS: Final = 1.0
"""Time after the end of a command until a line names the threads that are left."""

LINGER_SECONDS: Final = 10.0
"""Time after the end of a command until the process ends without them."""


def limit_threads(code: int, said: float = SAID_SECONDS, most: float = LINGER_SECONDS) -> None:
    """Bound the wait for threads that code of a world has started, at the end of a command.

    Python waits for them without a word when the main thread ends. A thread with `daemon=True` ends
    with the process. `code` is the exit code of the command, `said` and `most` are seconds.
    """
    if _left():
        threading.Thread(target=_end_without, args=(code, said, most), daemon=True).start()


def _end_without(code: int, said: float, most: float) -> None:
    threading.main_thread().join()
    began = time.monotonic()
    # Threads of executors end when Python asks them to.
    if names := _left(said):
        print(  # noqa: T201
            f"minerva: waiting for the thread {', '.join(names)}, which code of the world has"
            f" started; it is ended after {most:g} s. Make it a thread with daemon=True, or end it",
            file=sys.stderr,
            flush=True,
        )
        _left(began + most - time.monotonic())
        sys.stdout.flush()
        os._exit(code)


def _left(seconds: float = 0.0) -> list[str]:
    """The names of threads for which Python would wait, after these seconds."""
    until, own = time.monotonic() + seconds, (threading.main_thread(), threading.current_thread())
    left = [each for each in threading.enumerate() if not (each.daemon or each in own)]
    for each in left:
        each.join(max(0.0, until - time.monotonic()))
    return sorted(repr(each.name) for each in left if each.is_alive())
