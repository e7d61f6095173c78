"""Signals that end a run, and the signal that a child has ended."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Generator, Mapping
from contextlib import ExitStack, contextmanager
from types import FrameType
from typing import Final, TypeAlias

from minerva_bus.errors import UserCodeError
from minerva_bus.launch.child_processes import Pipes
from minerva_bus.user_code import WORLD_CODE

Handler: TypeAlias = Callable[[int, FrameType | None], None]

FRAME_SECONDS: Final = 1.0
"""Longest time, in seconds, that an interrupt waits for the end of a frame."""


def end_signals() -> tuple[signal.Signals, ...]:
    """The signals that end this process: Ctrl-C, SIGTERM and the terminal's hang-up.

    A hang-up that is ignored, as under `nohup`, stays ignored.
    """
    numbers = signal.SIGINT, signal.SIGTERM
    ignored = signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    return numbers if ignored else (*numbers, signal.SIGHUP)


@contextmanager
def handled(handlers: Mapping[signal.Signals, Handler]) -> Generator[None]:
    """Handle these signals, and restore the former handlers at the end of the block."""
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def interrupts_deferred() -> Generator[Callable[[], bool]]:
    """Defer KeyboardInterrupt; yields a function that says whether one is pending.

    The block ends at the next frame boundary if one is, and then raises KeyboardInterrupt: within a
    frame it would separate a record or a table from the string. It is raised at once by a second
    signal, and after FRAME_SECONDS, because user code may never return. In a thread other than the
    main one, where signals have no effect, nothing is deferred.

    Raises UserCodeError if code of the world has raised a KeyboardInterrupt, without a signal.
    """
    pending = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield pending.is_set
        return
    with ExitStack() as stack:

        def defer(number: int, frame: FrameType | None) -> None:
            if pending.is_set():
                raise KeyboardInterrupt
            pending.set()
            # A signal to the thread, unlike `interrupt_main`, also ends a blocking call like sleep.
            again = signal.pthread_kill, (threading.main_thread().ident, signal.SIGINT)
            timer = threading.Timer(FRAME_SECONDS, *again)
            timer.daemon = True
            timer.start()
            stack.callback(timer.cancel)

        raising = [n for n in end_signals() if signal.getsignal(n) is signal.default_int_handler]
        stack.enter_context(handled(dict.fromkeys(raising, defer)))
        try:
            yield pending.is_set
        except KeyboardInterrupt as error:
            # A handler that this function has not replaced may raise it for a signal.
            if pending.is_set() or signal.SIGINT not in raising:
                raise
            raise UserCodeError(WORLD_CODE) from error
    if pending.is_set():
        raise KeyboardInterrupt


@contextmanager
def caught(pipes: Pipes, interrupted: Callable[[signal.Signals], None]) -> Generator[None]:
    """Wake a wait for `pipes` at each signal; call `interrupted` for `end_signals`."""

    def interrupt(number: int, _: FrameType | None) -> None:
        interrupted(signal.Signals(number))

    read, write = os.pipe()
    # Python requires a non-blocking descriptor for wake-ups, as a full pipe must not block.
    os.set_blocking(read, False)
    os.set_blocking(write, False)
    # Without the pipe, a signal just before the wait begins would not end it.
    signal.set_wakeup_fd(write, warn_on_full_buffer=False)
    pipes.listen(read, lambda: pipes.read(read))
    # Python writes to the pipe only for signals that have a handler, hence one for SIGCHLD.
    wanted = {signal.SIGCHLD: _ignore, **dict.fromkeys(end_signals(), interrupt)}
    try:
        with handled(wanted):
            yield
    finally:
        signal.set_wakeup_fd(-1)
        pipes.forget(read)
        os.close(write)


def _ignore(number: int, frame: FrameType | None) -> None:
    """Do nothing: the signal has written to the pipe already."""
