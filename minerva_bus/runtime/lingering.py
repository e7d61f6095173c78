"""Threads of a world's code that outlive a command: they are named, and the process ends."""

from __future__ import annotations

import os
import sys
import threading
import time
from typing import Final

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
        threading.Thread(target=_end, args=(code, said, most), daemon=True).start()


def _end(code: int, said: float, most: float) -> None:
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
