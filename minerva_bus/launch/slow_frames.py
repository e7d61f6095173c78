"""Reports of frames that take long in one process, with the line of user code that is executed.

On the bus the coordinator notices a member that does not answer. In one process the thread of the
frames is the one that is blocked, so another thread looks at it.
"""

from __future__ import annotations

import sys
import threading
import time
import traceback
from collections.abc import Callable, Generator
from contextlib import contextmanager
from itertools import takewhile
from typing import Final

from minerva_bus.source import SourceLine, function_name, innermost

LOOK_SECONDS: Final = 10.0
"""Time between two looks at the frame; a frame that is the same in both is slow."""


@contextmanager
def slow_frames_reported(
    frame: Callable[[], int],
    report: Callable[[float, SourceLine], None],
    began_in: str,
    seconds: float = LOOK_SECONDS,
) -> Generator[None]:
    """Report frames of this thread that take long; each after one look, two, four, ...

    Args:
        frame: the number of the current frame.
        report: called in another thread with the seconds for which the frame has been seen, and
            the line that it executes.
        began_in: the source file that runs the frames; older code belongs to the caller.
        seconds: time between two looks.

    """
    ended, watched = threading.Event(), threading.get_ident()

    def look() -> None:
        seen, since, looks = frame(), time.monotonic(), 0
        while not ended.wait(seconds):
            if frame() != seen:
                seen, since, looks = frame(), time.monotonic(), 0
                continue
            looks += 1
            place = _executed(watched, began_in)
            if place is not None and looks & (looks - 1) == 0:
                report(time.monotonic() - since, place)

    thread = threading.Thread(target=look, name="slow frames", daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def _executed(thread: int, began_in: str) -> SourceLine | None:
    """The line of user code that a thread executes, if it executes any."""
    top = sys._current_frames().get(thread)  # pyright: ignore[reportPrivateUsage]
    if top is None:
        return None
    # A frame has no line while an instruction is executed that belongs to none.
    places = (
        SourceLine(
            frame.f_code.co_filename,
            line or frame.f_code.co_firstlineno,
            function_name(frame.f_code),
        )
        for frame, line in traceback.walk_stack(top)
    )
    return innermost(list(takewhile(lambda place: place.file != began_in, places)))
