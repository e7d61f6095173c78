"""pygame's display: driver selection, opening, and explanation of failures."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

from minerva_bus.errors import MisuseError


def quiet() -> None:
    """Keep SDL and pygame from printing, handling signals and inhibiting screen savers.

    Call before the first import of pygame.
    """
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    os.environ.setdefault("SDL_NO_SIGNAL_HANDLERS", "1")
    os.environ.setdefault("SDL_VIDEO_ALLOW_SCREENSAVER", "1")
    os.environ.setdefault("SDL_VIDEO_X11_WMCLASS", "minerva")


def drivers(environment: Mapping[str, str]) -> str:
    """SDL drivers to try, by environment; left to themselves, some show nothing."""
    names = [("DISPLAY", "x11"), ("WAYLAND_DISPLAY", "wayland")]
    return ",".join(driver for name, driver in names if environment.get(name))


def begin(service: str) -> None:
    """Select SDL's driver and initialise it. Raises MisuseError."""
    import pygame

    if names := drivers(os.environ):
        os.environ.setdefault("SDL_VIDEODRIVER", names)
    try:
        pygame.display.init()
    except pygame.error as error:
        raise _no_window(service, error) from None
    pygame.display.set_icon(_icon())


def _icon() -> Any:
    """The icon: a robot as drawn in pictures."""
    import pygame

    icon = pygame.Surface((64, 64), pygame.SRCALPHA, 32)
    pygame.draw.aacircle(icon, "#5a4a3a", (32, 32), 30)
    pygame.draw.aacircle(icon, "#e07a2f", (32, 32), 27)
    pygame.draw.polygon(icon, "white", [(53, 32), (18, 19), (25, 32), (18, 45)])
    return icon


def open_window(service: str, title: str, size: tuple[int, int], flags: int = 0) -> Any:
    """Open pygame's window, which is resizable; returns its surface.

    `flags` are added to RESIZABLE, such as OPENGL | DOUBLEBUF. Raises MisuseError.
    """
    import pygame

    begin(service)
    try:
        surface = pygame.display.set_mode(size, pygame.RESIZABLE | flags)
    except pygame.error as error:
        pygame.display.quit()
        raise _no_window(service, error) from None
    pygame.display.set_caption(title)
    # A held arrow key changes a number repeatedly (milliseconds).
    pygame.key.set_repeat(350, 60)
    return surface


def close_window() -> None:
    """Close pygame's window, if there is one."""
    import pygame

    pygame.display.quit()


def _no_window(service: str, error: Exception) -> MisuseError:
    return MisuseError(
        f"{service}: cannot open a window here ({str(error).strip()}); write pictures with"
        " path=FILE.png, or a video with video=FILE.mp4"
    )
