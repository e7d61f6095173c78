"""Generated blocks of documents, between `<!-- KIND: NAME -->` and `<!-- end of END -->`."""

from __future__ import annotations

import re
from collections.abc import Callable

_MARKER = re.compile(r"^<!-- (?:(\w+): ([\w ]+)|end of (\w+)) -->$", re.M)


def filled(text: str, kind: str, make: Callable[[str], str]) -> str:
    """The text with the content of each block of a kind replaced by `make(name)`.

    Exits with a message for a marker without its counterpart: text between two blocks would be
    lost.
    """
    parts: list[str] = []
    done, begin = 0, None
    for match in _MARKER.finditer(text):
        if kind not in (match[1], match[3]):
            continue
        if (begin is None) == (match[1] is None):
            _stop(text, begin or match)
        if begin is None:
            begin = match
            parts += [text[done : match.end()], "\n", make(match[2])]
        else:
            begin, done = None, match.start()
    if begin is not None:
        _stop(text, begin)
    return "".join([*parts, text[done:]])


def _stop(text: str, match: re.Match[str]) -> None:
    line = text.count("\n", 0, match.start()) + 1
    missing = "its end marker" if match[1] else "a start marker before it"
    raise SystemExit(f"line {line}: {match[0]} lacks {missing}")
