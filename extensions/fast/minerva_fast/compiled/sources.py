"""Functions of `portable` as machine code, compiled from their own source."""

from __future__ import annotations

from collections.abc import Callable
from types import FunctionType
from typing import Any, TypeGuard

from minerva_bus import portable
from minerva_bus.portable import trigonometry as circle


class PortableForms:
    """Compiled forms for one number of functions of `portable`, each made once."""

    def __init__(self, compiled: Callable[..., Any], far: Callable[..., Any]) -> None:
        """Create the forms.

        Args:
            compiled: numba's decorator with its options.
            far: in place of the reduction of huge angles, which needs ints of any length.

        """
        self._compiled = compiled
        self._made: dict[FunctionType, Any] = {circle.far: compiled(far)}

    def of(self, function: Any) -> Any:
        """A function of `portable` and the functions of `portable` that it calls, compiled."""
        form: FunctionType = getattr(function, "one", function)
        if form not in self._made:
            scope = dict(form.__globals__)
            for name in form.__code__.co_names:
                if is_portable(scope.get(name)):
                    scope[name] = self.of(scope[name])
            self._made[form] = self._compiled(FunctionType(form.__code__, scope, form.__name__))
        return self._made[form]


def is_portable(value: Any) -> TypeGuard[FunctionType]:
    """Whether an object is a function of `portable`."""
    return isinstance(value, FunctionType) and value.__module__.startswith(portable.__name__)
