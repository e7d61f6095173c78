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

from minerva_bus.source import SourceLine, innermost, is_foreign

STACK_SIGNAL: Final = signal.SIGUSR1
"""The signal at which a process writes the stacks of its threads."""

END_OF_STACKS: Final = "end of the stacks"
STOPPED: Final = "no stack: the process is stopped"
NOT_STARTED: Final = "no stack: the process does not run"
ENDS: Final = (END_OF_STACKS, STOPPED, NOT_STARTED)
"""The last line of an answer to a request for stacks."""

_THREAD: Final = re.compile(r"(?:Current thread|Thread) 0x[0-9a-f]+ .*\(most recent call first\):$")
_FRAME: Final = re.compile(r'  File "(?P<file>.*)", line (?P<line>\d+) in (?P<function>.*)$')
_CUT: Final = "  ..."
"""Follows the 100 most recent calls of a thread, and stands for the others."""

_REMARKS: Final = (_CUT, "  Garbage-collecting", "  <no Python frame>")


def register() -> None:
    """Write the stacks of this process to standard error at each STACK_SIGNAL."""
    faulthandler.register(STACK_SIGNAL, file=sys.stderr, all_threads=True, chain=False)


def is_stack(line: str) -> bool:
    """Whether a printed line is part of a stack."""
    return bool(_THREAD.match(line) or _FRAME.match(line)) or line in _REMARKS


def blocked_at(stacks: Sequence[str], began_in: str) -> SourceLine | None:
    """The line of user code that the main thread was executing at the signal, if it is known.

    `began_in` is the source file that forked the process: older frames belong to the launcher.
    """
    place = innermost(own_frames(stacks, began_in))
    # A package is user code if the framework calls it, which a truncated stack does not show.
    if place is not None and is_foreign(place.file) and _CUT in _main_thread(stacks):
        return None
    return place


def own_frames(stacks: Iterable[str], began_in: str) -> list[SourceLine]:
    """The frames of the main thread, most recent call first, after the fork."""
    frames = filter(None, map(_FRAME.match, _main_thread(stacks)))
    places = (SourceLine(each["file"], int(each["line"]), each["function"]) for each in frames)
    return list(takewhile(lambda place: place.file != began_in, places))


def _main_thread(stacks: Iterable[str]) -> list[str]:
    """The lines of the thread that was written last.

    The newest thread is first. The current one, which is marked, is that which got the signal: any
    thread of the process may.
    """
    lines: list[str] = []
    for line in stacks:
        if _THREAD.match(line):
            lines = []
        else:
            lines.append(line)
    return lines
