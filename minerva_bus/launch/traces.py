"""Stacks of a member that does not respond, as written by Python's faulthandler.

The handler runs at once, also during a blocking call; a stopped process writes nothing. It writes
to the output of the process, among the lines that the process prints.
"""

from __future__ import annotations

import faulthandler
import re
import signal
import sys
from collections.abc import Iterable, Sequence
from itertools import takewhile
from typing import Final

from minerva_bus.source import SourceLine, innermost

STACK_SIGNAL: Final = signal.SIGUSR1
"""The signal at which a process writes the stacks of its threads."""

END_OF_STACKS: Final = "end of the stacks"
STOPPED: Final = "no stack: the process is stopped"
NOT_STARTED: Final = "no stack: the process does not run"
ENDS: Final = (END_OF_STACKS, STOPPED, NOT_STARTED)
"""The last line of an answer to a request for stacks."""

_THREAD: Final = re.compile(r"(?:Current thread|Thread) 0x[0-9a-f]+ .*\(most recent call first\):$")
_FRAME: Final = re.compile(r'  File "(?P<file>.*)", line (?P<line>\d+) in (?P<function>.*)$')
_REMARKS: Final = ("  ...", "  Garbage-collecting", "  <no Python frame>")


def register() -> None:
    """Write the stacks of this process to standard error at each STACK_SIGNAL."""
    faulthandler.register(STACK_SIGNAL, file=sys.stderr, all_threads=True, chain=False)


def is_stack(line: str) -> bool:
    """Whether a printed line is part of a stack."""
    return bool(_THREAD.match(line) or _FRAME.match(line)) or line in _REMARKS


def blocked_at(stacks: Sequence[str], began_in: str) -> SourceLine | None:
    """The line of user code that the main thread was executing at the signal.

    `began_in` is the source file that forked the process: older frames belong to the launcher.
    """
    return innermost(own_frames(stacks, began_in))


def own_frames(stacks: Iterable[str], began_in: str) -> list[SourceLine]:
    """The frames of the main thread, most recent call first, after the fork."""
    return list(takewhile(lambda place: place.file != began_in, _main_thread(stacks)))


def _main_thread(stacks: Iterable[str]) -> list[SourceLine]:
    """The frames of the thread that was written last.

    The newest thread is first. The current one, which is marked, is that which got the signal: any
    thread of the process may.
    """
    frames: list[SourceLine] = []
    for line in stacks:
        frame = _FRAME.match(line)
        if frame is not None:
            frames.append(SourceLine(frame["file"], int(frame["line"]), frame["function"]))
        elif _THREAD.match(line):
            frames = []
    return frames
