"""Phrases for messages that several layers use, their pauses, and characters for XML."""

import importlib.util
import re
import shlex
import sys
from collections.abc import Sequence
from math import inf
from typing import Final

NO_VALUE: Final = "\0"
"""Text of an option that the command line gives without a value; no word of it can be this."""

_MIN_SECONDS: Final = 1.0
_MAX_SECONDS: Final = 60.0


class BackOff:
    """Reports with pauses that double from 1 s to 60 s; times are of one monotonic clock."""

    def __init__(self) -> None:
        self._next: float = -inf
        self._pause: float = _MIN_SECONDS

    def is_due(self, now: float) -> bool:
        """Whether to report now; then the next pause begins."""
        if now < self._next:
            return False
        self._next = now + self._pause
        self._pause = min(2 * self._pause, _MAX_SECONDS)
        return True


def counted(number: int, noun: str) -> str:
    """A number with its noun: `1 agent`, `1,200 agents`, `2 processes`."""
    ending = "" if number == 1 else "es" if noun.endswith("s") else "s"
    return f"{number:,} {noun}{ending}"


def duration(seconds: float) -> str:
    """A duration in words: `0.4 s`, `30 s`, `5 min`."""
    if seconds < 1:
        return f"{seconds:.1f} s"
    return f"{seconds:.0f} s" if seconds < 100 else f"{seconds / 60:.0f} min"


def named_some(names: Sequence[str], most: int) -> str:
    """The first names and the number of the others: `a, b and 7 more`."""
    more = f" and {len(names) - most:,} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


def install(extra: str) -> str:
    """The command that installs an extra into the environment that runs this program."""
    # A plain `pip` may belong to another environment, and one that uv has made has no pip.
    python, package = shlex.quote(sys.executable), f"'minerva-bus[{extra}]'"
    if importlib.util.find_spec("pip") is None:
        return f"uv pip install --python {python} {package}"
    return f"{python} -m pip install {package}"


def short(text: str, longest: int = 110) -> str:
    """A text that fits a line of `longest` characters."""
    return text if len(text) <= longest else f"{text[: longest - 1]}…"


_UNWRITABLE: Final = "[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]"
"""Characters that XML 1.0 does not allow, not even escaped."""


def xml_characters(text: str) -> str:
    """The text with U+FFFD in place of characters that XML does not allow."""
    # Compiled at its first use, which takes longer than all else that this module does.
    return re.sub(_UNWRITABLE, "\ufffd", text)
