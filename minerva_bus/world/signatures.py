"""Checks of method signatures when a class is defined, before the first frame calls them."""

from __future__ import annotations

import inspect
from collections.abc import Sequence
from types import FunctionType
from typing import Any

from minerva_bus.errors import SignatureError
from minerva_bus.source import handler_name


def check_signature(function: Any, what: str, expected: Sequence[str]) -> None:
    """Raise SignatureError if a function cannot be called with the expected arguments.

    `expected` are the names of positional arguments, beginning with `self`; `what` describes the
    function in the error. Only plain functions are checked, not static methods, for example.
    """
    if not isinstance(function, FunctionType):
        return
    try:
        # The wrapper of a decorated function is what is called.
        signature = inspect.signature(function, follow_wrapped=False)
    except ValueError:
        return
    try:
        # Only number and kind of the arguments matter; the names are placeholders.
        signature.bind(*expected)
    except TypeError:
        names = ", ".join(str(value) for value in signature.parameters.values())
        problem = f"{handler_name(function)} takes ({names}); {what} takes ({', '.join(expected)})"
        raise SignatureError(problem, function) from None


def check_overridden(cls: type, base: type, names: Sequence[str]) -> None:
    """Raise SignatureError if a class overrides methods of its base with other arguments."""
    for name in names:
        function = vars(cls).get(name)
        if function is not None:
            expected = list(inspect.signature(getattr(base, name)).parameters)
            check_signature(function, f"{base.__name__}.{name}", expected)
