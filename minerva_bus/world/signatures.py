"""Checks of method signatures when a class is defined, before the first frame calls them."""

from __future__ import annotations

import inspect
from collections.abc import Sequence
from types import FunctionType, MethodType
from typing import Any, Final

from minerva_bus.errors import SignatureError
from minerva_bus.source import handler_name


def check_signature(
    function: Any, what: str, expected: Sequence[str], *, may_yield: bool = False
) -> None:
    """Raise SignatureError if a function cannot be called with the expected arguments.

    `expected` are the names of positional arguments, beginning with `self`; `what` describes the
    function in the error. Nothing awaits an `async` function, and only functions that `may_yield`
    are iterated: others would never run. Only functions and methods are checked, not objects that
    can be called.
    """
    if not isinstance(function, FunctionType | MethodType):
        return
    if inspect.iscoroutinefunction(function) or inspect.isasyncgenfunction(function):
        problem = f"{handler_name(function)} is async, so it would never run; write def"
        raise SignatureError(f"{problem}, and wait in a thread of your own", function)
    if inspect.isgeneratorfunction(function) and not may_yield:
        problem = f"{handler_name(function)} has a yield, so it would never run"
        raise SignatureError(f"{problem}; {what} returns its result", function)
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


ITERATED: Final = ("generate", "generates")
"""The methods of services whose result may be any iterable."""


def check_overridden(cls: type, base: type, names: Sequence[str]) -> None:
    """Raise SignatureError if a class overrides methods of its base with other arguments."""
    for name in names:
        function = vars(cls).get(name)
        if function is not None:
            expected = list(inspect.signature(getattr(base, name)).parameters)
            may_yield = name in ITERATED
            check_signature(function, f"{base.__name__}.{name}", expected, may_yield=may_yield)
