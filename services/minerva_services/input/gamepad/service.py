"""The bridge to a gamepad: options, and the events of its stick and buttons."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar, Final, Protocol

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.events import Event
from minerva_bus.world.services import WorldInfo
from minerva_services.bridging import Bridge, OpenSource, Source, SourceError
from minerva_services.input.controls import ControlMap, InputRange, bindings, choices
from minerva_services.options import names_in, require

POLL_SECONDS: Final = 0.02
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
        require("gamepad", "pygame", "pygame-ce", "gamepad")
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
        self.concerns = names_in(to)
        self._controls = ControlMap("gamepad", bound, slide, self.concerns)
        self._pad, self._axis, self._dead, self._slides = pad, axis, dead, bool(slide)

    def generates(self) -> tuple[str, ...]:
        return self._controls.generates()

    def check(self, world: WorldInfo) -> None:
        self._controls.joined(world)

    def open(self) -> Source:
        """Raises SourceError if no such gamepad is connected."""
        pad = open_pad(self._pad)
        self._log(f"{self.source}: {pad.name}; " + ", ".join(self._controls.descriptions()))
        return OpenSource(partial(self._events, pad), pad.close)

    def _events(self, pad: Pad, stop: threading.Event) -> Iterator[Event | None]:
        """Poll the gamepad: events as buttons are pressed and the stick moves."""
        # Buttons that are down when the gamepad is opened do not count as pressed.
        before, sent = pad.state(), 0.0
        while not stop.wait(POLL_SECONDS):
            state = pad.state()
            if state is None or before is None:
                if sent:
                    yield self._controls.slid(0.0)  # a robot must not drive on without its gamepad
                raise SourceError(f"{self.source} was unplugged")
            for button in sorted(state.buttons - before.buttons):
                yield self._pressed(button)
            number = self._slid(state)
            if number != sent:
                sent = number
                yield self._controls.slid(number)
            before = state
            yield None

    def _pressed(self, button: int) -> Event | None:
        event = self._controls.pressed(str(button))
        if event is None:
            self.count("other buttons")
        return event

    def _slid(self, state: PadState) -> float:
        """The number that the stick gives."""
        way = -state.axes[self._axis] if self._slides and self._axis < len(state.axes) else 0.0
        # Scaled to the travel outside the dead zone, so the value does not jump at its edge.
        far = max(0.0, abs(way) - self._dead) / (1 - self._dead)
        return self._range.nearest(far * (self._range.high if way > 0 else self._range.low))


@dataclass(frozen=True, slots=True)
class PadState:
    """Current state of a gamepad: axes from -1 to 1, and pressed buttons."""

    axes: tuple[float, ...]
    buttons: frozenset[int]


class Pad(Protocol):
    """A connected gamepad."""

    name: str

    def state(self) -> PadState | None:
        """Its current state; None if it was unplugged."""
        ...

    def close(self) -> None:
        """Release the gamepad."""
        ...


def open_pad(number: int) -> Pad:
    """Open a gamepad by number, from 0. Raises SourceError if there is none."""
    pygame = _begun()
    pygame.event.pump()
    there = pygame.joystick.get_count()
    if number >= there:
        which = f"only {there} are plugged in" if there else "none is plugged in"
        raise SourceError(f"there is no gamepad {number}: {which}")
    try:
        return _Joystick(pygame, pygame.joystick.Joystick(number))
    except pygame.error as error:
        raise SourceError(f"gamepad {number} is not usable: {error}") from None


def _begun() -> Any:
    """pygame, initialised for gamepads: SDL reports them together with a display's events.

    A process without a window uses a dummy display.
    """
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    # SDL must not replace the process's handler of SIGINT.
    os.environ.setdefault("SDL_NO_SIGNAL_HANDLERS", "1")
    # A process without the focused window receives no joystick events otherwise.
    os.environ.setdefault("SDL_JOYSTICK_ALLOW_BACKGROUND_EVENTS", "1")
    import pygame

    if not pygame.display.get_init():
        os.environ["SDL_VIDEODRIVER"] = "dummy"
        pygame.display.init()
    pygame.joystick.init()
    return pygame


class _Joystick:
    """A joystick of SDL."""

    def __init__(self, pygame: Any, joystick: Any) -> None:
        self._pygame = pygame
        self._joystick = joystick
        self.name = str(joystick.get_name())

    def state(self) -> PadState | None:
        self._pygame.event.pump()
        joystick = self._joystick
        try:
            if not joystick.get_init() or not self._attached():
                return None
            axes = tuple([float(joystick.get_axis(i)) for i in range(joystick.get_numaxes())])
            down = frozenset(
                [i for i in range(joystick.get_numbuttons()) if joystick.get_button(i)]
            )
        except self._pygame.error:
            return None
        return PadState(axes, down)

    def _attached(self) -> bool:
        """SDL keeps an unplugged joystick and merely stops listing it."""
        joystick = self._pygame.joystick
        own = self._joystick.get_instance_id()
        return any(
            joystick.Joystick(number).get_instance_id() == own
            for number in range(joystick.get_count())
        )

    def close(self) -> None:
        self._joystick.quit()
