"""A terminal read key by key, whose settings are restored afterwards."""

from __future__ import annotations

import atexit
import codecs
import os
import re
import select
import termios
import threading
import tty
from collections.abc import Iterator
from contextlib import suppress
from typing import Final

from minerva_services.bridging import SourceError

POLL_SECONDS: Final = 0.1
MAX_BYTES: Final = 1024


class Terminal:
    """The terminal at a path, or that of standard input, without echo and line buffering.

    Ctrl-C still interrupts. Raises SourceError if it is not a terminal.
    """

    def __init__(self, path: str = "") -> None:
        self._path = path
        try:
            # O_NOCTTY: the terminal must not become the controlling one of this process.
            self._file = os.open(path, os.O_RDWR | os.O_NOCTTY) if path else 0
            self._before = termios.tcgetattr(self._file)
        except (OSError, termios.error) as error:
            raise SourceError(
                f"{path or 'standard input'} is not a terminal ({error.args[-1]});"
                " attach the keyboard"
                " from a terminal: minerva attach keyboard"
            ) from None
        self._closed = False
        self._lock = threading.Lock()
        # The shell needs its settings back however the process ends.
        atexit.register(self.close)
        # TCSANOW keeps the keys that have been typed already; the default discards them.
        tty.setcbreak(self._file, termios.TCSANOW)

    def read(self) -> bytes | None:
        """Typed bytes, empty after a tenth of a second without any.

        None if the terminal is gone.
        """
        try:
            if not select.select([self._file], [], [], POLL_SECONDS)[0]:
                return b""
            return os.read(self._file, MAX_BYTES) or None
        except (OSError, ValueError):
            return None

    def close(self) -> None:
        """Restore the terminal; discards unread input."""
        # The bridge's thread and the end of the process both close the terminal.
        with self._lock:
            if self._closed:
                return
            self._closed = True
            with suppress(termios.error):
                # Keys that were meant for the world must not reach the shell.
                termios.tcsetattr(self._file, termios.TCSAFLUSH, self._before)
            if self._path:
                os.close(self._file)
        atexit.unregister(self.close)


_ARROWS: Final = {"A": "up", "B": "down", "C": "right", "D": "left"}
_SIGNS: Final = {
    " ": "space", "\r": "enter", "\n": "enter", "\t": "tab", "\x7f": "backspace", "\x1b": "escape"
}  # fmt: skip
_KEY: Final = re.compile(r"\x1b(?:\[[0-9;]*|O)([@-~])|.", re.DOTALL)
# The beginning of a sequence at the end of a chunk. Its length is limited, so that input without a
# final byte cannot accumulate.
_BEGUN: Final = re.compile(r"\x1b(?:\[[0-9;]{0,16}|O)?\Z")


NAMED_KEYS: Final = tuple(dict.fromkeys((*_ARROWS.values(), *_SIGNS.values())))
"""The names of keys that are not those of their characters."""


def is_key(name: str) -> bool:
    """Whether a key can have this name."""
    return name in NAMED_KEYS or (len(name) == 1 and name.isprintable() and name not in _SIGNS)


class KeyDecoder:
    """Decodes bytes (UTF-8 with the escape sequences of ECMA-48) to key names.

    A printable key is named by its character; others are `up`, `down`, `left`, `right`, `space`,
    `enter`, `tab`, `backspace` and `escape`. Unknown keys have the name "".
    """

    def __init__(self) -> None:
        # Incremental, because a read may end within a character.
        self._decoder = codecs.getincrementaldecoder("utf-8")("replace")
        self._begun = ""

    def named(self, data: bytes) -> Iterator[str]:
        """The keys in a chunk of bytes; an empty chunk ends an escape sequence begun before it."""
        text = self._begun + self._decoder.decode(data)
        # Only a pause distinguishes the key Esc from the first byte of a sequence.
        begun = _BEGUN.search(text) if data else None
        self._begun = begun.group() if begun else ""
        for match in _KEY.finditer(text.removesuffix(self._begun)):
            final, sign = match.group(1), match.group()
            if final is not None:
                yield _ARROWS.get(final, "")
            else:
                yield _SIGNS.get(sign, sign if sign.isprintable() else "")
