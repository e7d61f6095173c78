"""The signals that a launcher lives with: Ctrl-C, SIGTERM, and that of a child's end."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Generator
from contextlib import contextmanager
from types import FrameType

from minerva_bus.launch.pipes import Pipes


@contextmanager
def caught(pipes: Pipes, interrupted: Callable[[signal.Signals], None]) -> Generator[None]:
    """Let all of them end the waiting for pipes, and `interrupted` hear of SIGINT and SIGTERM."""

    def interrupt(number: int, _: FrameType | None) -> None:
        interrupted(signal.Signals(number))

    read, write = os.pipe()
    os.set_blocking(read, False)
    os.set_blocking(write, False)
    signal.set_wakeup_fd(write, warn_on_full_buffer=False)
    pipes.listen(read, lambda: pipes.read(read))
    wanted = {signal.SIGCHLD: _ignore, signal.SIGINT: interrupt, signal.SIGTERM: interrupt}
    before = {number: signal.getsignal(number) for number in wanted}
    for number, handler in wanted.items():
        signal.signal(number, handler)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        signal.set_wakeup_fd(-1)
        pipes.forget(read)
        os.close(write)


def _ignore(number: int, frame: FrameType | None) -> None:
    """Do nothing: the pipe has told already."""
