"""The bridge to a gamepad: options, and the events of its stick and buttons."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping
from typing import Any, ClassVar, Final

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.events import Event
from minerva_bus.world.services import WorldInfo
from minerva_services.bridging import Bridge, SourceError
from minerva_services.input.controls import ControlMap, InputRange, bindings, choices
from minerva_services.input.gamepad.pad import Pad, PadState, check_installed, open_pad

POLLED_EVERY: Final = 0.02
"""Polling interval in seconds: shorter than any button press."""


class Gamepad(Bridge):
    """Turns a gamepad's stick and buttons into events.

    The stick gives a number: `high` when pushed fully, `low` when pulled, 0 at rest and when the
    gamepad is lost while pushed. A button emits its event when pressed. Without a gamepad, the
    bridge waits for one.

    Args:
        pad: number of the gamepad, from 0.
        slide: the event type with one real number that the stick emits; "" for none.
        axis: axis of the stick, from 0; pushed is -1.
        low: value when pulled; 0: none.
        high: value when pushed.
        step: resolution of the values.
        dead: fraction of the stick's travel, 0 to 1, that counts as rest.
        choose: the event type with one string that the first buttons emit.
        markers: the strings, for the buttons from 0 on; a list, or a comma-separated string.
        buttons: further buttons: `{ 7 = "eSpeed speed=0" }`.
        to: ids of the receiving agents, comma-separated; "": all.

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
        self._range = InputRange(low, high, step)
        self._range.check("gamepad")
        chosen = choices("gamepad", choose, markers)
        bound = {
            **{str(number): binding for number, binding in enumerate(chosen)},
            **bindings("gamepad", "buttons", buttons),
        }
        wrong = [name for name in bound if not name.isdecimal()]
        if wrong:
            raise MisuseError(f"gamepad: buttons.{wrong[0]}: buttons are numbered, from 0")
        self.source = f"gamepad {pad}"
        self.controls = ControlMap("gamepad", bound, slide, to)
        self._pad, self._axis, self._dead, self._slides = pad, axis, dead, bool(slide)

    def generates(self) -> tuple[str, ...]:
        return self.controls.generates()

    def joined(self, world: WorldInfo) -> None:
        self.controls.joined(world)

    def open(self) -> GamepadSource:
        """Raises SourceError if no such gamepad is connected."""
        pad = open_pad(self._pad)
        self._log(f"{self.source}: {pad.name}; " + ", ".join(self.controls.descriptions()))
        return GamepadSource(self, pad)

    def slid(self, state: PadState) -> float:
        """The number that the stick gives."""
        way = -state.axes[self._axis] if self._slides and self._axis < len(state.axes) else 0.0
        far = max(0.0, abs(way) - self._dead) / (1 - self._dead)
        return self._range.nearest(far * (self._range.high if way > 0 else self._range.low))


class GamepadSource:
    """A gamepad that is polled."""

    def __init__(self, bridge: Gamepad, pad: Pad) -> None:
        self._bridge = bridge
        self._pad = pad
        self._number = 0.0

    def read(self, stop: threading.Event) -> Iterator[Event | None]:
        """Events as buttons are pressed and the stick moves."""
        before = self._pad.state()
        while not stop.wait(POLLED_EVERY):
            state = self._pad.state()
            if state is None or before is None:
                yield from self._slid(0.0)
                raise SourceError(f"{self._bridge.source} was unplugged")
            for button in sorted(state.buttons - before.buttons):
                yield self._pressed(button)
            yield from self._slid(self._bridge.slid(state))
            before = state
            yield None

    def close(self) -> None:
        """Release the gamepad."""
        self._pad.close()

    def _pressed(self, button: int) -> Event | None:
        event = self._bridge.controls.pressed(str(button))
        if event is None:
            self._bridge.count("other buttons")
        return event

    def _slid(self, number: float) -> Iterator[Event]:
        if number != self._number:
            self._number = number
            yield self._bridge.controls.slid(number)
