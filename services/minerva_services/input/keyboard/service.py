"""The bridge to a terminal's keys: options, and the event of each key."""

from __future__ import annotations

import atexit
import codecs
import os
import re
import select
import termios
import threading
import tty
from collections.abc import Iterator, Mapping
from contextlib import suppress
from functools import partial
from typing import Any, ClassVar, Final

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.events import Event
from minerva_bus.world.services import WorldInfo
from minerva_services.bridging import Bridge, OpenSource, Source, SourceError
from minerva_services.input.controls import ControlMap, InputRange, bindings, choices
from minerva_services.options import names_in

DIGITS: Final = "1234567890"


class Keyboard(Bridge):
    """Turns keys pressed in a terminal into events.

    The up and down arrows change a number, digits choose among markers, and `keymap` binds further
    keys; it takes precedence.

    Args:
        slide: the event type with one real number that the arrows emit; "" for none.
        step: change per key press.
        low: the minimum.
        high: the maximum.
        begin: the initial number.
        choose: the event type with one string that the digits emit.
        markers: the strings, for the digits 1 to 9 and 0; a list, or a comma-separated string.
        keymap: further keys: `{ w = "eSpeed speed=0.8", space = "eSpeed speed=0" }`.
        to: ids of the receiving agents, comma-separated; "": all.
        terminal: path of a terminal; "": the one in which the command was started.

    """

    source_option: ClassVar[str] = "terminal"
    reconnects = False
    interactive = people = True

    def __init__(
        self,
        slide: str = "eSpeed",
        step: float = 0.1,
        low: float = 0.0,
        high: float = 1.0,
        begin: float = 0.0,
        choose: str = "eObjective",
        markers: Any = (),
        keymap: Mapping[str, Any] | None = None,
        to: str = "",
        terminal: str = "",
    ) -> None:
        super().__init__()
        self.source = "the keyboard"
        self._range = InputRange(low, high, step)
        self._range.check("keyboard")
        chosen = choices("keyboard", choose, markers)
        if len(chosen) > len(DIGITS):
            raise MisuseError(f"keyboard: {len(chosen)} markers; there are only ten digits")
        bound = {
            **dict(zip(DIGITS, chosen, strict=False)),
            **bindings("keyboard", "keymap", keymap),
        }
        unknown = next((name for name in bound if not is_key(name)), None)
        if unknown is not None:
            raise MisuseError(
                f"keyboard: keymap.{unknown}: no key has this name; expected a character, or one of"
                f" {', '.join(NAMED_KEYS)}"
            )
        self.concerns = names_in(to)
        self._controls = ControlMap("keyboard", bound, slide, self.concerns)
        self._moves = {"up": step, "down": -step} if slide else {}
        self._slide, self._value, self._path = slide, begin, terminal
        self._terminal: Terminal | None = None

    def generates(self) -> tuple[str, ...]:
        return self._controls.generates()

    def check(self, world: WorldInfo) -> None:
        self._controls.joined(world)

    def joined(self, world: WorldInfo) -> None:
        self.check(world)
        # Opened before the world runs, where a missing terminal can still be reported as misuse.
        self._terminal = self._opened()

    def _opened(self) -> Terminal:
        try:
            return Terminal(self._path)
        except SourceError as error:
            raise MisuseError(f"keyboard: {error}") from None

    def open(self) -> Source:
        """Log the available keys and start listening."""
        arrows = [f"up and down {self._slide}"] if self._moves else []
        self._log(f"keys: {', '.join(arrows + self._controls.descriptions())}; Ctrl-C quits")
        terminal = self._terminal or self._opened()
        return OpenSource(partial(self._events, terminal), terminal.close)

    def _events(self, terminal: Terminal, stop: threading.Event) -> Iterator[Event | None]:
        """Events as keys are pressed, until the terminal is gone."""
        keys = KeyDecoder()
        while not stop.is_set() and (data := terminal.read()) is not None:
            for key in keys.named(data):
                yield self._pressed(key)
            yield None

    def _pressed(self, key: str) -> Event | None:
        """The event of a key; unbound keys are counted."""
        event = self._controls.pressed(key)
        if event is None and key in self._moves:
            self._value = self._range.bounded(self._value + self._moves[key])
            event = self._controls.slid(self._value)
        if event is None:
            self.count("other keys")
        else:
            # The terminal does not echo, so the log is the only feedback.
            self._log(str(event))
        return event

    def close(self) -> None:
        """Restore the terminal."""
        if self._terminal is not None:
            self._terminal.close()


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
