"""The bridge to a terminal's keys: options, and the event of each key."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any, ClassVar, Final

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.events import Event
from minerva_bus.world.services import WorldInfo
from minerva_services.bridging import Bridge, OpenSource, Source, SourceError
from minerva_services.input.controls import ControlMap, InputRange, bindings, choices
from minerva_services.input.keyboard.terminal import NAMED_KEYS, KeyDecoder, Terminal, is_key

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
        self._controls = ControlMap("keyboard", bound, slide, to)
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
