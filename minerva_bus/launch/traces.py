"""Where a member stands that does not answer: the stacks that Python's faulthandler writes.

The handler runs at once, whatever Python code or blocking call the process is in; a process that is
stopped writes nothing. It writes where the process prints, so its lines are told from others.
"""

from __future__ import annotations

import faulthandler
import re
import signal
import sys
from collections.abc import Iterable, Iterator, Sequence
from itertools import takewhile
from typing import Final

from minerva_bus.source import Place, innermost

ASK: Final = signal.SIGUSR1
"""The signal that lets a process write the stacks of its threads."""

_THREAD: Final = re.compile(r"(?:Current thread|Thread) 0x[0-9a-f]+ .*\(most recent call first\):$")
_FRAME: Final = re.compile(r'  File "(?P<file>.*)", line (?P<line>\d+) in (?P<function>.*)$')
_CURRENT: Final = "Current thread"


def register() -> None:
    """Let this process write its stacks on standard error when it is asked by the signal."""
    faulthandler.register(ASK, file=sys.stderr, all_threads=True, chain=False)


def is_stack(line: str) -> bool:
    """Whether a printed line is one of a stack."""
    return bool(_THREAD.match(line) or _FRAME.match(line)) or line == "  ..."


def blocked_at(stacks: Sequence[str], began_in: str) -> Place | None:
    """The line of user code in which the thread that was asked is.

    `began_in` is the source file whose frame started the process: what is beyond is not its own.
    """
    return innermost(list(takewhile(lambda place: place.file != began_in, _current(stacks))))


def _current(stacks: Iterable[str]) -> Iterator[Place]:
    current = False
    for line in stacks:
        frame = _FRAME.match(line)
        if frame is None:
            current = line.startswith(_CURRENT)
        elif current:
            yield Place(frame["file"], int(frame["line"]), frame["function"])
