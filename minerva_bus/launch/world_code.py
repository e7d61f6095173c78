"""Code of a world that runs before its processes do: modules, and what a world file names."""

from __future__ import annotations

import os
import threading
from collections.abc import Generator
from contextlib import contextmanager
from dis import opmap
from typing import Any, Final, NoReturn

_RAISE: Final = opmap["RAISE_VARARGS"]


@contextmanager
def world_code() -> Generator[None]:
    """A context for code of a world, which must not end the command without a word.

    `os._exit` raises SystemExit in it; a KeyboardInterrupt that the code itself raises becomes a
    RuntimeError. That of Ctrl-C stays what it is.
    """
    end, process, thread = os._exit, os.getpid(), threading.get_ident()

    def refuse(status: int) -> NoReturn:
        # A child process must end here, and so may another thread, as at a second Ctrl-C.
        if (os.getpid(), threading.get_ident()) != (process, thread):
            end(status)
        raise SystemExit(status)

    attributes: Any = os
    attributes._exit = refuse
    try:
        yield
    except KeyboardInterrupt as interrupt:
        if not _is_raised(interrupt):
            raise
        raise RuntimeError("code of a world must not raise KeyboardInterrupt") from interrupt
    finally:
        attributes._exit = end


def _is_raised(interrupt: KeyboardInterrupt) -> bool:
    """Whether a `raise` in Python has raised it: signals arrive between other instructions."""
    trace = interrupt.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    return trace is not None and trace.tb_frame.f_code.co_code[trace.tb_lasti] == _RAISE
