"""What a method must take, checked when its class is made: not in the first frame that calls it."""

from __future__ import annotations

import inspect
from collections.abc import Sequence
from types import FunctionType
from typing import Any

from minerva_bus.errors import SignatureError
from minerva_bus.source import handler_name


def check_signature(function: Any, what: str, expected: Sequence[str]) -> None:
    """Whether a function can be called with so many positional arguments.

    `expected` names them, beginning with `self`, and `what` says what the function is. Whatever is
    no plain function, such as a static method, is not checked. Raises SignatureError.
    """
    if not isinstance(function, FunctionType):
        return
    try:
        signature = inspect.signature(function, follow_wrapped=False)
    except ValueError:
        return
    try:
        signature.bind(*expected)
    except TypeError:
        names = ", ".join(str(value) for value in signature.parameters.values())
        problem = f"{handler_name(function)} takes ({names}); {what} takes ({', '.join(expected)})"
        raise SignatureError(problem, function) from None


def check_overridden(cls: type, base: type, names: Sequence[str]) -> None:
    """Whether what a class defines can be called as its base's are. Raises SignatureError."""
    for name in names:
        function = vars(cls).get(name)
        if function is not None:
            expected = list(inspect.signature(getattr(base, name)).parameters)
            check_signature(function, f"{base.__name__}.{name}", expected)
