"""The bridge to a gamepad: its options, and what its stick and its buttons give."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping
from typing import Any, ClassVar, Final

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.events import Event
from minerva_bus.world.services import WorldInfo
from minerva_services.bridging import Bridge, SourceError
from minerva_services.input.controls import Range, Wiring, bindings, choices
from minerva_services.input.gamepad.pad import Held, Pad, check_installed, open_pad

POLLED_EVERY: Final = 0.02
"""Seconds: nobody presses a button for less."""


class Gamepad(Bridge):
    """Turns a gamepad's stick and buttons into events.

    The stick gives a number: `high` where it is pushed wholly, `low` where it is pulled, 0 at rest,
    and 0 too where the gamepad is lost while it is pushed. A button gives its event when it is
    pressed. Without a gamepad it waits for one.

    Args:
        pad: the number of the gamepad, from 0.
        slide: the event type with one real number that the stick sends; "" for none.
        axis: of the stick, from 0; pushed is -1.
        low: what it gives where it is pulled; 0: nothing.
        high: what it gives where it is pushed.
        step: of the numbers that it gives.
        dead: part of the stick's way, 0 to 1, that counts as rest.
        choose: the event type with one text that the first buttons send.
        markers: the texts, for the buttons from 0 on; a list, or texts with commas between.
        buttons: further buttons: `{ 7 = "eSpeed speed=0" }`.
        to: ids of the agents that it is for, with commas between; "": for all.

    """

    source_option: ClassVar[str] = "pad"
    interactive = people = True

    def __init__(
        self,
        pad: int = 0,
        slide: str = "eSpeed",
        axis: int = 1,
        low: float = 0.0,
        high: float = 1.0,
        step: float = 0.05,
        dead: float = 0.15,
        choose: str = "eObjective",
        markers: Any = (),
        buttons: Mapping[str, Any] | None = None,
        to: str = "",
    ) -> None:
        super().__init__()
        check_installed()
        if pad < 0 or axis < 0:
            raise MisuseError("gamepad: pad and axis count from 0")
        if not 0 <= dead < 1 or not low <= 0 < high:
            raise MisuseError("gamepad: expected dead from 0 to below 1, low up to 0, high above 0")
        self._range = Range(low, high, step)
        self._range.check("gamepad")
        chosen = choices("gamepad", choose, markers)
        bound = {
            **{str(number): one for number, one in enumerate(chosen)},
            **bindings("gamepad", "buttons", buttons),
        }
        wrong = [name for name in bound if not name.isdecimal()]
        if wrong:
            raise MisuseError(f"gamepad: buttons.{wrong[0]}: buttons are numbered, from 0")
        self.source = f"gamepad {pad}"
        self.wiring = Wiring("gamepad", bound, slide, to)
        self._pad, self._axis, self._dead, self._slides = pad, axis, dead, bool(slide)

    def generates(self) -> tuple[str, ...]:
        return self.wiring.generates()

    def joined(self, world: WorldInfo) -> None:
        self.wiring.joined(world)

    def open(self) -> GamepadSource:
        """Raises SourceError where no such gamepad is plugged in, or it has no such axis."""
        pad = open_pad(self._pad)
        self._say(f"{self.source}: {pad.name}; " + ", ".join(self.wiring.told()))
        return GamepadSource(self, pad)

    def slid(self, held: Held) -> float:
        """The number that the stick gives."""
        way = -held.axes[self._axis] if self._slides and self._axis < len(held.axes) else 0.0
        far = max(0.0, abs(way) - self._dead) / (1 - self._dead)
        return self._range.nearest(far * (self._range.high if way > 0 else self._range.low))


class GamepadSource:
    """A gamepad that is looked at again and again."""

    def __init__(self, bridge: Gamepad, pad: Pad) -> None:
        self._bridge = bridge
        self._pad = pad
        self._number = 0.0

    def read(self, stop: threading.Event) -> Iterator[Event | None]:
        """Events, as buttons go down and the stick moves."""
        before = self._pad.held()
        while not stop.wait(POLLED_EVERY):
            held = self._pad.held()
            if held is None or before is None:
                yield from self._slid(0.0)
                raise SourceError(f"{self._bridge.source} was pulled out")
            for button in sorted(held.buttons - before.buttons):
                yield self._pressed(button)
            yield from self._slid(self._bridge.slid(held))
            before = held
            yield None

    def close(self) -> None:
        """Let go of it."""
        self._pad.close()

    def _pressed(self, button: int) -> Event | None:
        event = self._bridge.wiring.pressed(str(button))
        if event is None:
            self._bridge.count("other buttons")
        return event

    def _slid(self, number: float) -> Iterator[Event]:
        if number != self._number:
            self._number = number
            yield self._bridge.wiring.slid(number)
