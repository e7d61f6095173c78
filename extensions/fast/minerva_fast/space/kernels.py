"""Functions that numba compiles when a rule needs them, and that Python can run as they are.

A kernel calls kernels that are names of its module and functions of `portable`, and uses its
module's numbers. Functions of `math`, except the square root, have other last bits on other
machines.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Generator, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from enum import Enum
from functools import cache
from hashlib import blake2b
from types import CodeType, FunctionType, ModuleType
from typing import Any, Final, Generic, ParamSpec, TypeVar, cast

import numpy as np

from minerva_bus import portable
from minerva_fast.compiled.loading import ALLOCATING, NUMBA_OPTIONS, numba_library
from minerva_fast.compiled.sources import PortableForms, is_portable

_P = ParamSpec("_P")
_R = TypeVar("_R")

_CHECKED: Final = {"boundscheck": True, "nogil": True}
"""Indices are checked, because a rule computes its own; threads may share a rule."""
OPTIONS: Final[Mapping[str, Any]] = {**NUMBA_OPTIONS, **_CHECKED}
ALLOCATING_OPTIONS: Final[Mapping[str, Any]] = {**ALLOCATING, **_CHECKED}
"""For rules that create arrays."""

PURPOSE: Final = "rules of a space"
"""What needs numba, in messages."""

_FROZEN: Final = (int, float, str, tuple, np.generic, np.ndarray)
"""Objects of a module whose values become part of the compiled code."""

_interpreting: ContextVar[bool] = ContextVar("interpreting", default=False)


class Kernel(Generic[_P, _R]):
    """A function that other kernels and rules can call; called from Python, it runs as Python."""

    def __init__(self, function: Callable[_P, _R]) -> None:
        self.function = cast("FunctionType", function)
        self.__doc__ = function.__doc__
        self.__name__ = self.function.__name__
        self._compiled: Any = None

    def __call__(self, *args: _P.args, **kwargs: _P.kwargs) -> _R:
        return self.function(*args, **kwargs)

    @property
    def called(self) -> dict[Kernel[..., Any], None]:
        """The kernels that it calls, itself or by kernels that it calls, in their order."""
        known = dict[Kernel[..., Any], None]()
        pending = [cast("Kernel[..., Any]", self)]
        while pending:
            new = [each for _, each in helpers(pending.pop().function) if each not in known]
            known |= dict.fromkeys(new)
            pending += new
        return known

    def forget(self) -> None:
        """Compile it and the kernels that it calls again when they are next used."""
        if self._compiled is not None:
            self._compiled = None
            for _, helper in helpers(self.function):
                helper.forget()

    @property
    def compiled(self) -> Any:
        """The function as a dispatcher of numba. Raises MisuseError without numba."""
        if self._compiled is None:
            # Inlined, because a call would pass each array of a table as seven numbers.
            self._compiled = numba().njit(inline="always", **OPTIONS)(rebound(self.function))
        return self._compiled


def kernel(function: Callable[_P, _R]) -> Kernel[_P, _R]:
    """Mark a function as one that rules may call.

    Example:
        >>> @kernel
        ... def hungry(sheep, i):
        ...     return sheep.energy[i] < 2.0

    """
    return Kernel(function)


def numba() -> Any:
    """The library numba. Raises MisuseError if it is not installed."""
    return numba_library(PURPOSE)


@cache
def _portable_forms() -> PortableForms:
    return PortableForms(numba().njit(**OPTIONS), _too_far)


def _too_far(x: float) -> tuple[int, float, float]:
    raise ValueError("an angle of more than 1.6 million radians")


def _of_portable(used: Collection[str]) -> ModuleType:
    """The module `portable` with compiled forms of those of its functions that are used."""
    module = ModuleType(portable.__name__)
    for name in sorted(set(portable.__all__) & set(used)):
        setattr(module, name, _portable_form(getattr(portable, name)))
    return module


def _portable_form(function: FunctionType) -> Any:
    """The compiled form of a function of `portable`, with faults if it has any."""
    # Here, because numba is optional.
    from minerva_fast.space.functions import FUNCTIONS

    return FUNCTIONS.get(function) or _portable_forms().of(function)


def rebound(function: FunctionType) -> FunctionType:
    """The same function; its kernels and functions of `portable` replaced by compiled ones."""
    scope, used = dict(function.__globals__), function.__code__.co_names
    for name, helper in helpers(function):
        scope[name] = helper.compiled
    for name in used:
        value = scope.get(name)
        if value is portable:
            scope[name] = _of_portable(used)
        elif is_portable(value):
            scope[name] = _portable_form(value)
    return FunctionType(function.__code__, scope, function.__name__, function.__defaults__)


def key(function: FunctionType) -> str:
    """A digest of the code that a function consists of, with its kernels and numbers."""
    digest = blake2b(digest_size=12)
    for code in sorted(_code(function, {})):
        digest.update(code)
    return digest.hexdigest()


def helpers(function: FunctionType) -> Iterator[tuple[str, Kernel[..., Any]]]:
    """The kernels that a function names."""
    for name in function.__code__.co_names:
        helper = function.__globals__.get(name)
        if isinstance(helper, Kernel):
            yield name, cast("Kernel[..., Any]", helper)


def _code(function: FunctionType, known: dict[CodeType, bytes]) -> list[bytes]:
    code = function.__code__
    if code not in known:
        scope: dict[str, Any] = function.__globals__
        numbers = [(name, _spelled(each)) for name, each in _named(scope, code.co_names)]
        defaults = repr(function.__defaults__)
        parts = (code.co_code, code.co_consts, code.co_names, code.co_varnames, numbers, defaults)
        known[code] = repr(parts).encode()
        for _, helper in helpers(function):
            _code(helper.function, known)
    return list(known.values())


def _named(scope: dict[str, Any], names: Collection[str]) -> Iterator[tuple[str, Any]]:
    """Constants that a function names, also as `module.NAME` and `Class.NAME`."""
    for name in names:
        value = scope.get(name)
        if isinstance(value, _FROZEN):
            yield name, value
        elif isinstance(value, ModuleType | type):
            for inner in names:
                constant: Any = getattr(value, inner, None)
                if isinstance(constant, (*_FROZEN, Enum)):
                    yield f"{name}.{inner}", constant


def _spelled(value: Any) -> str:
    """A text that differs for different constants."""
    if isinstance(value, np.ndarray):
        array = cast("np.ndarray[Any, Any]", value)
        return f"{array.dtype}{array.shape}{array.tobytes().hex()}"
    return repr(value)


@contextmanager
def interpreted() -> Generator[None]:
    """Run rules as Python within this context, such as for a debugger; results are the same."""
    token = _interpreting.set(True)
    try:
        yield
    finally:
        _interpreting.reset(token)


interpreting: Final[Callable[[], bool]] = _interpreting.get
"""Whether rules run as Python now. Each loop of a frame asks, so it is no function of ours."""
