"""Which methods of an agent class are compiled: those marked, or all that a world asks for."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from typing import Any, Final

from minerva_bus.compiled.activity import CompiledMethods
from minerva_bus.compiled.origin import NotCompilable
from minerva_bus.errors import MisuseError
from minerva_bus.world.declaring import COMPILED, POPULATION, marked, takes_batch

IF_POSSIBLE: Final = "if possible"


class NotCompiled(UserWarning):
    """A method runs agent by agent, because it cannot be compiled."""


def check_mode(compiled: object) -> None:
    """Raise MisuseError unless this is True, False or "if possible"."""
    if compiled not in (True, False, IF_POSSIBLE):
        raise MisuseError(f'compiled is True, False or "{IF_POSSIBLE}", not {compiled!r}')


def marked_compiled(cls: Any) -> CompiledMethods | None:
    """The methods of a class that are marked as compiled. Raises NotCompilable."""
    modes: dict[str, bool | str] = {
        event_type: getattr(marked(cls, event_type, function), COMPILED, False)
        for event_type, function in cls.activities.items()
        if not hasattr(function, "__wrapped__")
        or not getattr(function.__wrapped__, POPULATION, False)
    }
    return _compiled(cls, {event_type: mode for event_type, mode in modes.items() if mode})


def _compiled(cls: Any, modes: Mapping[str, bool | str]) -> CompiledMethods | None:
    chosen: dict[str, Callable[..., Any]] = {}
    for event_type, mode in sorted(modes.items()):
        function = cls.activities[event_type]
        if mode == IF_POSSIBLE:
            try:
                _made(cls, {event_type: function})
            except NotCompilable as error:
                warnings.warn(NotCompiled(str(error)), stacklevel=4)
                continue
        chosen[event_type] = function
    return _made(cls, chosen) if chosen else None


def _made(cls: Any, methods: Mapping[str, Callable[..., Any]]) -> CompiledMethods:
    together = frozenset(event for event, method in methods.items() if takes_batch(method))
    return CompiledMethods(cls, methods, together)
