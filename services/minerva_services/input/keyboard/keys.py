"""Decoding of terminal input to key names."""

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


class KeyDecoder:
    """Decodes bytes (UTF-8 with the escape sequences of ECMA-48) to key names.

    A printable key is named by its character; others are `up`, `down`, `left`, `right`, `space`,
    `enter`, `tab`, `backspace` and `escape`. Unknown keys have the name "".
    """

    def __init__(self) -> None:
        self._decoder = codecs.getincrementaldecoder("utf-8")("replace")

    def named(self, data: bytes) -> Iterator[str]:
        """The keys in a chunk of bytes."""
        for match in _KEY.finditer(self._decoder.decode(data)):
            final, sign = match.group(1), match.group()
            if final is not None:
                yield _ARROWS.get(final, "")
            else:
                yield _SIGNS.get(sign, sign if sign.isprintable() else "")
