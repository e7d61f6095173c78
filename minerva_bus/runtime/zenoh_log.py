"""Reads Zenoh's log, which Zenoh can write to standard output only.

Python's own output bypasses the pipe, so that everything read from it is Zenoh's.
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
"""Size of the pipe, if the system allows it: a thread of Zenoh blocks when it is full."""

_CHOSEN, _PLAIN = "RUST_LOG", "NO_COLOR"


def begin_logging(levels: str, required: str = "") -> None:
    """Enable Zenoh's log at `levels`, or at those in the environment.

    The `required` levels are added to either. The log is coloured then, which an audit relies on.
    """
    if required:
        os.environ[_CHOSEN] = f"{os.environ.get(_CHOSEN) or levels},{required}"
        # Zenoh escapes colour sequences within keys, so only coloured lines cannot be forged.
        os.environ.pop(_PLAIN, None)
    zenoh.init_log_from_env_or(levels)


@contextmanager
def log_read(read_lines: Callable[[bytes], bytes], delay: float = 0.0) -> Generator[None]:
    """Pass whole lines of the log to `read_lines` in a thread; print its results.

    Must begin before the session. Lines gather for `delay` seconds: otherwise each line wakes the
    thread, which then takes the interpreter's lock from the frame.
    """
    read, write = os.pipe()
    if delay:
        _widen(write)
    # Buffered output must leave by the old descriptor before the pipe replaces it.
    sys.stdout.flush()
    output = os.dup(1)
    os.dup2(write, 1)
    os.close(write)
    reader = threading.Thread(target=_listen, args=(read, output, read_lines, delay), daemon=True)
    reader.start()
    try:
        with (
            open(output, "w", buffering=1, encoding="utf-8", errors="replace", closefd=False)
            as own,
            redirect_stdout(own),
        ):  # fmt: skip
            yield
    finally:
        os.dup2(output, 1)  # Closes the last writing end of the pipe, so that the reader ends.
        reader.join(1.0)


def _listen(read: int, output: int, read_lines: Callable[[bytes], bytes], delay: float) -> None:
    rest = b""
    while data := os.read(read, _ROOM):
        lines, end, rest = (rest + data).rpartition(b"\n")
        if end and (passed_on := read_lines(lines + end)):
            os.write(output, passed_on)
        # No delay while the pipe fills up: threads of Zenoh block when it is full.
        if delay and len(data) < _ROOM // 2:
            time.sleep(delay)
    os.close(read)


def _widen(pipe: int) -> None:
    """Enlarge a pipe for the lines of one delay; systems without this call keep 64 KiB."""
    with suppress(AttributeError, OSError):
        fcntl.fcntl(pipe, fcntl.F_SETPIPE_SZ, _ROOM)
