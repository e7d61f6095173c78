"""The bridge to a terminal's keys: its options, and what each key gives."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping
from typing import Any, ClassVar, Final

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.events import Event
from minerva_bus.world.services import WorldInfo
from minerva_services.bridging import Bridge, SourceError
from minerva_services.input.controls import Range, Wiring, bindings, choices
from minerva_services.input.keyboard.keys import Keys
from minerva_services.input.keyboard.terminal import Terminal

DIGITS: Final = "1234567890"


class Keyboard(Bridge):
    """Turns keys that are pressed in a terminal into events.

    The arrows up and down change a number, the digits choose among markers, and whatever else a
    person wants is in `keymap`, which goes first.

    Args:
        slide: the event type with one real number that the arrows send; "" for none.
        step: by which an arrow changes the number.
        low: the least.
        high: the greatest.
        begin: the number before the first arrow.
        choose: the event type with one text that the digits send.
        markers: the texts, for the digits 1 to 9 and 0; a list, or texts with commas between.
        keymap: further keys: `{ w = "eSpeed speed=0.8", space = "eSpeed speed=0" }`.
        to: ids of the agents that it is for, with commas between; "": for all.
        terminal: a terminal's path; "": the one that the command was given in.

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
        self._range = Range(low, high, step)
        self._range.check("keyboard")
        chosen = choices("keyboard", choose, markers)
        if len(chosen) > len(DIGITS):
            raise MisuseError(f"keyboard: markers are {len(chosen)}; there are but ten digits")
        bound = {
            **dict(zip(DIGITS, chosen, strict=False)),
            **bindings("keyboard", "keymap", keymap),
        }
        self._wiring = Wiring("keyboard", bound, slide, to)
        self._moves = {"up": step, "down": -step} if slide else {}
        self._slide, self._value, self._path = slide, begin, terminal
        self._terminal: Terminal | None = None

    def generates(self) -> tuple[str, ...]:
        return self._wiring.generates()

    def joined(self, world: WorldInfo) -> None:
        self._wiring.joined(world)
        self._terminal = self._opened()

    def _opened(self) -> Terminal:
        try:
            return Terminal(self._path)
        except SourceError as error:
            raise MisuseError(f"keyboard: {error}") from None

    def open(self) -> KeyboardSource:
        """Tell which keys there are, and listen to them."""
        arrows = [f"up and down {self._slide}"] if self._moves else []
        self._say("; ".join(["keys: " + ", ".join(arrows + self._wiring.told()), "Ctrl-C leaves"]))
        return KeyboardSource(self, self._terminal or self._opened())

    def pressed(self, key: str) -> Event | None:
        """What a key gives; one that gives nothing is counted."""
        event = self._wiring.pressed(key)
        if event is None and key in self._moves:
            self._value = self._range.bounded(self._value + self._moves[key])
            event = self._wiring.slid(self._value)
        if event is None:
            self.count("other keys")
        else:
            self._say(str(event))
        return event

    def close(self) -> None:
        """Leave the terminal as it was."""
        if self._terminal is not None:
            self._terminal.close()


class KeyboardSource:
    """A terminal whose keys are heard."""

    def __init__(self, bridge: Keyboard, terminal: Terminal) -> None:
        self._bridge = bridge
        self._terminal = terminal

    def read(self, stop: threading.Event) -> Iterator[Event | None]:
        """Events, as keys are pressed."""
        keys = Keys()
        while not stop.is_set():
            data = self._terminal.read()
            if data is None:
                return
            for key in keys.named(data):
                yield self._bridge.pressed(key)
            yield None

    def close(self) -> None:
        """Leave the terminal as it was."""
        self._terminal.close()
