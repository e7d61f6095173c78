"""Zenoh's log, which goes to standard output and nowhere else: it is read in its place.

Python's own output goes past it, so that what is read is the log's alone.
"""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false
from __future__ import annotations

import fcntl
import os
import sys
import threading
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager, redirect_stdout, suppress
from typing import Final

import zenoh

_ROOM: Final = 1 << 20
"""Bytes that a pipe may hold, where the system lets it: whoever logs waits where it is full."""

_CHOSEN, _PLAIN = "RUST_LOG", "NO_COLOR"


def begin_logging(levels: str, insisted: str = "") -> None:
    """Let Zenoh log at these levels, or those that the environment names.

    Those that are `insisted` on hold beside either; its log has colours then.
    """
    if insisted:
        os.environ[_CHOSEN] = f"{os.environ.get(_CHOSEN) or levels},{insisted}"
        os.environ.pop(_PLAIN, None)
    zenoh.init_log_from_env_or(levels)


@contextmanager
def log_read(hear: Callable[[bytes], bytes], nap: float = 0.0) -> Generator[None]:
    """Give whole lines of the log to `hear`, in a thread of its own; what it returns is passed on.

    To be begun before a session. `nap`: seconds in which lines gather; each wakes the thread
    otherwise, which costs a turn of the interpreter's lock.
    """
    read, write = os.pipe()
    if nap:
        _widen(write)
    sys.stdout.flush()
    output = os.dup(1)
    os.dup2(write, 1)
    os.close(write)
    reader = threading.Thread(target=_listen, args=(read, output, hear, nap), daemon=True)
    reader.start()
    try:
        with (
            open(output, "w", buffering=1, encoding="utf-8", errors="replace", closefd=False)
            as own,
            redirect_stdout(own),
        ):  # fmt: skip
            yield
    finally:
        os.dup2(output, 1)  # The last that could write into the pipe: the reader comes to its end.
        reader.join(1.0)


def _listen(read: int, output: int, hear: Callable[[bytes], bytes], nap: float) -> None:
    rest = b""
    while data := os.read(read, _ROOM):
        lines, end, rest = (rest + data).rpartition(b"\n")
        if end and (passed_on := hear(lines + end)):
            os.write(output, passed_on)
        if nap and len(data) < _ROOM // 2:
            time.sleep(nap)
    os.close(read)


def _widen(pipe: int) -> None:
    """Make room for what comes in a nap; systems that cannot keep their 64 KiB."""
    with suppress(AttributeError, OSError):
        fcntl.fcntl(pipe, fcntl.F_SETPIPE_SZ, _ROOM)
