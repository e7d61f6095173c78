"""A gamepad as SDL sees it, by pygame-ce (extra `gamepad`)."""

from __future__ import annotations

import importlib.util
import os
from dataclasses import dataclass
from typing import Any, Protocol

from minerva_bus.errors import MisuseError
from minerva_services.bridging import SourceError


@dataclass(frozen=True, slots=True)
class Held:
    """How a gamepad is held just now: its axes from -1 to 1, and the buttons that are down."""

    axes: tuple[float, ...]
    buttons: frozenset[int]


class Pad(Protocol):
    """A gamepad that is plugged in."""

    name: str

    def held(self) -> Held | None:
        """How it is held; None where it was pulled out."""
        ...

    def close(self) -> None:
        """Let go of it."""
        ...


def check_installed() -> None:
    """Raises MisuseError where the extra is not installed."""
    if importlib.util.find_spec("pygame") is None:
        raise MisuseError("gamepad needs pygame-ce: pip install 'minerva-bus[gamepad]'")


def open_pad(number: int) -> Pad:
    """The gamepad of a number, from 0. Raises SourceError where there is none."""
    pygame = _begun()
    pygame.event.pump()
    there = pygame.joystick.get_count()
    if number >= there:
        which = f"only {there} are plugged in" if there else "none is plugged in"
        raise SourceError(f"there is no gamepad {number}: {which}")
    try:
        return _Joystick(pygame, pygame.joystick.Joystick(number))
    except pygame.error as error:
        raise SourceError(f"gamepad {number} cannot be used: {error}") from None


def _begun() -> Any:
    """The pygame package, with what gamepads need: SDL tells of them along with a display's events.

    Where this process has no window, a display that shows nothing does.
    """
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    os.environ.setdefault("SDL_NO_SIGNAL_HANDLERS", "1")
    os.environ.setdefault("SDL_JOYSTICK_ALLOW_BACKGROUND_EVENTS", "1")
    import pygame

    if not pygame.display.get_init():
        os.environ["SDL_VIDEODRIVER"] = "dummy"
        pygame.display.init()
    pygame.joystick.init()
    return pygame


class _Joystick:
    """A joystick of SDL's."""

    def __init__(self, pygame: Any, joystick: Any) -> None:
        self._pygame = pygame
        self._joystick = joystick
        self.name = str(joystick.get_name())

    def held(self) -> Held | None:
        self._pygame.event.pump()
        one = self._joystick
        try:
            if not one.get_init() or not self._attached():
                return None
            axes = tuple([float(one.get_axis(i)) for i in range(one.get_numaxes())])
            down = frozenset([i for i in range(one.get_numbuttons()) if one.get_button(i)])
        except self._pygame.error:
            return None
        return Held(axes, down)

    def _attached(self) -> bool:
        """SDL keeps a joystick that was pulled out, and only no longer lists it."""
        joystick = self._pygame.joystick
        mine = self._joystick.get_instance_id()
        return any(
            joystick.Joystick(number).get_instance_id() == mine
            for number in range(joystick.get_count())
        )

    def close(self) -> None:
        self._joystick.quit()
