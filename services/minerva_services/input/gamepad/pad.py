"""Access to gamepads through SDL, using pygame-ce (extra `gamepad`)."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any, Protocol

from minerva_services.bridging import SourceError


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
