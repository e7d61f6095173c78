"""From what a terminal sends to the names of keys."""

from __future__ import annotations

import codecs
import re
from collections.abc import Iterator
from typing import Final

_ARROWS: Final = {"A": "up", "B": "down", "C": "right", "D": "left"}
_SIGNS: Final = {
    " ": "space", "\r": "enter", "\n": "enter", "\t": "tab", "\x7f": "backspace", "\x1b": "escape"
}  # fmt: skip
_KEY: Final = re.compile(r"\x1b(?:\[[0-9;]*|O)([@-~])|.", re.DOTALL)


class Keys:
    """Takes bytes (UTF-8, with the escape sequences of ECMA-48) and names the keys in them.

    A key that writes a sign has that sign's name; others are `up`, `down`, `left`, `right`,
    `space`, `enter`, `tab`, `backspace` and `escape`. What is none of these has no name: "".
    """

    def __init__(self) -> None:
        self._decoder = codecs.getincrementaldecoder("utf-8")("replace")

    def named(self, data: bytes) -> Iterator[str]:
        """The keys in some bytes."""
        for found in _KEY.finditer(self._decoder.decode(data)):
            final, sign = found.group(1), found.group()
            if final is not None:
                yield _ARROWS.get(final, "")
            else:
                yield _SIGNS.get(sign, sign if sign.isprintable() else "")
