"""Which methods of an agent class are compiled: those marked, or all that a world asks for."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from typing import Any, Final

from minerva_bus.compiled.activity import CompiledMethods, CompiledViews
from minerva_bus.compiled.origin import NotCompilable
from minerva_bus.errors import MisuseError
from minerva_bus.world.declaring import COMPILED, POPULATION, marked, takes_batch

IF_POSSIBLE: Final = "if possible"

Mode = bool | str
"""False, True, or "if possible"."""


def check_mode(compiled: object) -> None:
    """Raise MisuseError unless this is True, False or "if possible"."""
    if compiled not in (True, False, IF_POSSIBLE):
        raise MisuseError(f'compiled is True, False or "{IF_POSSIBLE}", not {compiled!r}')


def marked_compiled(cls: Any) -> CompiledMethods | None:
    """The methods of a class that are marked as compiled. Raises NotCompilable."""
    methods, reasons = _compiled(cls, _modes(cls, False))
    for reason in reasons:
        warnings.warn(reason, UserWarning, stacklevel=4)
    return methods


def marked_views(cls: Any) -> CompiledViews | None:
    """The views of a class that are marked as compiled. Raises NotCompilable."""
    views, reasons = _compiled_views(cls, _modes_of_views(cls, False))
    for reason in reasons:
        warnings.warn(reason, UserWarning, stacklevel=4)
    return views


def compile_all(cls: Any, mode: Mode) -> list[str]:
    """Compile all methods and views of a class for one agent, beside those marked.

    Returns why methods are not compiled, for `mode` "if possible". Raises NotCompilable for True.
    """
    reasons: list[str] = []
    modes = _modes(cls, mode)
    if {event_type for event_type, each in modes.items() if each} != set(cls.compiled or ()):
        cls.compiled, reasons = _compiled(cls, modes)
    modes = _modes_of_views(cls, mode)
    if {event_type for event_type, each in modes.items() if each} != set(cls.compiled_views or ()):
        cls.compiled_views, more = _compiled_views(cls, modes)
        reasons += more
    return reasons


def _modes_of_views(cls: Any, default: Mode) -> dict[str, Mode]:
    """How each view for one agent is to be compiled, by event type."""
    return {
        event_type: getattr(function, COMPILED, False) or default
        for event_type, function in sorted(cls.views.items())
        if event_type not in cls.population_views
    }


def _compiled_views(cls: Any, modes: Mapping[str, Mode]) -> tuple[CompiledViews | None, list[str]]:
    """The compiled views for one agent, and why others are not."""
    chosen: dict[str, Callable[..., Any]] = {}
    reasons: list[str] = []
    for event_type, mode in modes.items():
        function = cls.views[event_type]
        try:
            if mode:
                CompiledViews(cls, {event_type: function})
                chosen[event_type] = function
        except NotCompilable as error:
            if mode != IF_POSSIBLE:
                raise
            reasons.append(str(error))
    return (CompiledViews(cls, chosen) if chosen else None), reasons


def _modes(cls: Any, default: Mode) -> dict[str, Mode]:
    """How each method for one agent is to be compiled, by event type."""
    modes: dict[str, Mode] = {}
    for event_type, function in cls.activities.items():
        # Methods for populations are activities of one agent by a wrapper.
        if not getattr(getattr(function, "__wrapped__", None), POPULATION, False):
            modes[event_type] = (
                getattr(marked(cls, event_type, function), COMPILED, False) or default
            )
    return modes


def _compiled(cls: Any, modes: Mapping[str, Mode]) -> tuple[CompiledMethods | None, list[str]]:
    chosen: dict[str, Callable[..., Any]] = {}
    reasons: list[str] = []
    for event_type, mode in sorted(modes.items()):
        function = cls.activities[event_type]
        if mode == IF_POSSIBLE:
            try:
                _made(cls, {event_type: function})
            except NotCompilable as error:
                reasons.append(str(error))
                continue
        if mode:
            chosen[event_type] = function
    return (_made(cls, chosen) if chosen else None), reasons


def _made(cls: Any, methods: Mapping[str, Callable[..., Any]]) -> CompiledMethods:
    together = frozenset(event for event, method in methods.items() if takes_batch(method))
    return CompiledMethods(cls, methods, together)
