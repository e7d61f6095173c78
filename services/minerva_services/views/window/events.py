"""Keyboard and mouse input of pygame's window."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import pygame

from minerva_services.geometry.picture import Picture
from minerva_services.views.window.actions import WorldAction
from minerva_services.views.window.controls import NUMBERS, Action, WindowControls, action_of
from minerva_services.views.window.painter import Painter
from minerva_services.views.window.picking import Hit, pick

_DOUBLE_CLICK_SECONDS = 0.4
_DRAG_PIXELS = 4
"""Pixels of movement with a button held from which it is a drag, not a click."""


class WindowInput:
    """Processes keyboard and mouse events; `closed` once the window was closed."""

    def __init__(
        self, controls: WindowControls, painter: Painter, do: Callable[[WorldAction | None], None]
    ) -> None:
        self.closed = False
        self._controls = controls
        self._painter = painter
        self._do = do
        self._picture = Picture()
        self._pressed: dict[int, tuple[float, float]] = {}
        self._keys: set[int] = set()
        """Keys that are down; pygame reports a held key again and again."""
        self._dragged = False
        self._clicked = 0.0, ""

    def process(self, picture: Picture) -> bool:
        """Process all pending events; True if something must be redrawn."""
        self._picture = picture
        touched = False
        for event in pygame.event.get():
            touched |= self._take(event)
        return touched

    def _take(self, event: Any) -> bool:
        if event.type == pygame.QUIT:
            self.closed = True
        elif event.type == pygame.KEYDOWN:
            again = event.key in self._keys
            self._keys.add(event.key)
            # On many keyboards `?` is another key with shift, so its character counts as well.
            return any(
                self._key(name, again) for name in (pygame.key.name(event.key), event.unicode)
            )
        elif event.type == pygame.KEYUP:
            self._keys.discard(event.key)
        elif event.type == pygame.MOUSEBUTTONDOWN and event.button <= 3:
            self._pressed[event.button] = event.pos
            self._dragged = False
        elif event.type == pygame.MOUSEBUTTONUP and event.button in self._pressed:
            return self._release(event.button, event.pos)
        elif event.type == pygame.MOUSEMOTION:
            return self._move(event.pos, event.rel)
        elif event.type == pygame.MOUSEWHEEL:
            # Touchpads scroll by fractions of a step.
            self._painter.zoom(getattr(event, "precise_y", event.y), pygame.mouse.get_pos())
            return True
        elif event.type == pygame.VIDEORESIZE:
            self._painter.resized((event.w, event.h))
            return True
        return event.type in (pygame.WINDOWEXPOSED, pygame.WINDOWSHOWN)

    def _key(self, name: str, again: bool) -> bool:
        action = action_of(name)
        # All others would take back or repeat what the person wants once.
        if again and action not in (Action.MORE, Action.LESS):
            return False
        # pygame names the keys of a keypad [1] to [9].
        if (number := name.strip("[]")) in NUMBERS:
            self._do(self._controls.send_plain(number))
            return True
        if action is None:
            return False
        if action is Action.FIT:
            self._controls.stop_following()
            self._painter.fit()
        self._do(self._controls.press(action, self._picture))
        return True

    def _move(self, at: tuple[int, int], by: tuple[int, int]) -> bool:
        if not self._pressed:
            return False
        button, start = next(iter(self._pressed.items()))
        if not self._dragged and max(abs(at[0] - start[0]), abs(at[1] - start[1])) < _DRAG_PIXELS:
            return False
        if not self._dragged:
            # The first pixels count as well, or the picture would lag behind the mouse.
            by = at[0] - int(start[0]), at[1] - int(start[1])
            self._dragged = True
        if self._painter.drag(*by, button):
            self._controls.stop_following()
        return True

    def _release(self, button: int, at: tuple[int, int]) -> bool:
        del self._pressed[button]
        if self._dragged:
            # While another button is held, its release must not count as a click.
            self._dragged = bool(self._pressed)
            return True
        hit = pick(self._picture, self._painter.project, self._painter.labels(), at)
        if button == 1:
            self._do(self._controls.click(hit, double=self._is_second(hit)))
        elif button == 3:
            self._do(self._controls.click_aside(hit))
        return True

    def _is_second(self, hit: Hit | None) -> bool:
        """True for a second click on the same agent within a short time."""
        now, agent = time.monotonic(), hit.agent if hit is not None else ""
        (before, other), self._clicked = self._clicked, (now, agent)
        return bool(agent) and agent == other and now - before < _DOUBLE_CLICK_SECONDS
