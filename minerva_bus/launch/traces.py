"""Stacks of a member that does not respond, as written by Python's faulthandler.

The handler runs at once, also during a blocking call; a stopped process writes nothing. It writes
to the output of the process, among the lines that the process prints.
"""

from __future__ import annotations

import faulthandler
import re
import signal
import sys
from collections.abc import Iterable, Iterator, Sequence
from itertools import takewhile
from typing import Final

from minerva_bus.source import SourceLine, innermost

STACK_SIGNAL: Final = signal.SIGUSR1
"""The signal at which a process writes the stacks of its threads."""

_THREAD: Final = re.compile(r"(?:Current thread|Thread) 0x[0-9a-f]+ .*\(most recent call first\):$")
_FRAME: Final = re.compile(r'  File "(?P<file>.*)", line (?P<line>\d+) in (?P<function>.*)$')
_CURRENT: Final = "Current thread"


def register() -> None:
    """Write the stacks of this process to standard error at each STACK_SIGNAL."""
    faulthandler.register(STACK_SIGNAL, file=sys.stderr, all_threads=True, chain=False)


def is_stack(line: str) -> bool:
    """Whether a printed line is part of a stack."""
    return bool(_THREAD.match(line) or _FRAME.match(line)) or line == "  ..."


def blocked_at(stacks: Sequence[str], began_in: str) -> SourceLine | None:
    """The line of user code that the thread was executing at the signal.

    `began_in` is the source file that forked the process: older frames belong to the launcher.
    """
    return innermost(list(takewhile(lambda place: place.file != began_in, _current(stacks))))


def _current(stacks: Iterable[str]) -> Iterator[SourceLine]:
    current = False
    for line in stacks:
        frame = _FRAME.match(line)
        if frame is None:
            current = line.startswith(_CURRENT)
        elif current:
            yield SourceLine(frame["file"], int(frame["line"]), frame["function"])
