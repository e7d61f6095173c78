"""Functions that numba compiles when a rule needs them, and that Python can run as they are.

A kernel calls kernels that are names of its module and functions of `portable`, and uses its
module's numbers. Functions of `math`, except the square root, have other last bits on other
machines.

Random numbers are the methods of `moment.chance` as functions, with the same numbers. All rules of
a frame continue one stream, that of (seed, id of the space, frame).

Arrays of a rule are guarded: they refuse every index but those of rows or cells that exist. numpy
and numba read a negative index from the end of an array, and the arrays of a table have room for
newborns after its rows. A rule that computes an index, such as `i - 1` or the result of `beside`,
must not read or change those.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Collection, Generator, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from enum import Enum
from functools import cache
from hashlib import blake2b
from types import CodeType, FunctionType, ModuleType
from typing import Any, Final, Generic, ParamSpec, TypeAlias, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from minerva_bus import portable
from minerva_bus.portable.distributions import (
    draw_chance,
    draw_exponential,
    draw_integers,
    draw_normal,
    draw_random,
    draw_uniform,
)
from minerva_fast.compiled.machine_code import (
    ALLOCATING,
    NUMBA_OPTIONS,
    PortableForms,
    is_portable,
    numba_library,
)

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
    from minerva_fast.space.operators import FUNCTIONS

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


Draws: TypeAlias = NDArray[np.uint64]
"""A random stream, shape (1,); the parameter of a rule with this annotation."""


@kernel
def random(draws: Draws) -> float:
    """Uniform in [0, 1)."""
    return draw_random(draws, 0)


@kernel
def uniform(draws: Draws, low: float = 0.0, high: float = 1.0) -> float:
    """Uniform in [low, high)."""
    return draw_uniform(draws, 0, low, high)


@kernel
def integers(draws: Draws, low: int, high: int | None = None) -> int:
    """An int in [low, high), or in [0, low) without `high`. Raises ValueError if there is none."""
    if high is None:
        least, below = 0, low
    else:
        least, below = low, high
    # The difference is what is drawn, so it must not be too large.
    if below - least <= 0:
        raise ValueError(EMPTY_RANGE)
    return draw_integers(draws, 0, least, below)


@kernel
def chance(draws: Draws, probability: float) -> bool:
    """True with this probability."""
    return draw_chance(draws, 0, probability)


@kernel
def exponential(draws: Draws, mean: float = 1.0) -> float:
    """Exponentially distributed, with this mean."""
    return draw_exponential(draws, 0, -mean)


@kernel
def normal(draws: Draws, mean: float = 0.0, deviation: float = 1.0) -> float:
    """Normally distributed; takes two draws."""
    return draw_normal(draws, 0, mean, deviation)


@kernel
def shuffle(draws: Draws, rows: NDArray[np.int64]) -> None:
    """Put rows into a random order (Fisher and Yates)."""
    for last in range(len(rows) - 1, 0, -1):
        other = integers(draws, 0, last + 1)
        row = rows[last]
        rows[last] = rows[other]
        rows[other] = row


EMPTY_RANGE = "integers: no int is in this range; expected low < high"


ALL: Final = -1
"""In place of an item of `counts`: all items of the array may be used."""
UNCHECKED: Final = -2
"""In place of an item of `counts`: indices are not compared."""

NO_INT: Final = "a rule has one int as index; write int(...) for a real"
FAULT: Final = "machine code has no result for these numbers"
MIXED: Final = "a number here is an int in one case and a real in another"
READ_ONLY: Final = "an assignment to a matrix that stays as it is, such as `before`"
REAL_IN_CELLS: Final = "Cells are ints, and this is a real: write int(...), or use Reals"


class Guarded:
    """An array as a rule that runs as Python sees it."""

    __slots__ = ("_counts", "_name", "_slot", "_values")

    def __init__(
        self, name: str, values: NDArray[Any], counts: NDArray[np.int64], slot: int
    ) -> None:
        self._name = name
        self._values = values
        self._counts = counts
        self._slot = slot

    def __len__(self) -> int:
        return len(self._values) if self._slot == ALL else int(self._counts[self._slot])

    def __getitem__(self, index: int) -> Any:
        # A number of Python, because numpy's have no ZeroDivisionError, and fewer bits.
        return self._values[self._checked(index)].item()

    def __setitem__(self, index: int, value: float) -> None:
        place = self._checked(index)
        if not self._values.flags.writeable:
            raise TypeError(f"{self._name}[{index}]: {READ_ONLY}")
        if self._values.dtype.kind == "i":
            if isinstance(value, float):
                raise TypeError(REAL_IN_CELLS)
            value = int(value)  # An int of numpy that is too large would lose its upper bits.
        self._values[place] = value

    def _checked(self, index: Any) -> int:
        try:
            place = operator.index(index)
        except TypeError:
            raise TypeError(f"{self._name}[{index!r}]: {NO_INT}") from None
        if not 0 <= place < len(self):
            raise IndexError(f"{self._name}[{index}]: the index must be from 0 to {len(self) - 1}")
        return place


@dataclass(frozen=True, slots=True)
class Guard:
    """Makes the guarded form of an array, with its number of items in `counts`.

    Attributes:
        name: of the array, for messages.
        slot: the item of `counts` with the number of items that exist, or ALL.

    """

    name: str
    slot: int = ALL

    def __call__(self, values: NDArray[Any], counts: NDArray[np.int64]) -> Guarded:
        return Guarded(self.name, values, counts, self.slot)

    @property
    def compiled(self) -> Any:
        """The same for machine code. Raises ImportError without numba."""
        # Here, because numba is optional.
        from minerva_fast.space.operators import guard

        return guard(self.slot)

    @property
    def key(self) -> str:
        """What machine code with it depends on."""
        return str(self.slot)


class _Unchecked(Kernel[[Any], Any]):
    """A kernel whose machine code is not compiled from its function."""

    @property
    def compiled(self) -> Any:
        """The same for machine code. Raises ImportError without numba."""
        from minerva_fast.space.operators import unchecked

        return unchecked


def _same(array: Any) -> Any:
    """An array without index checks, for kernels whose indices are known to exist.

    In rules that run as Python it is the same array, which checks them.
    """
    return array


unchecked: Final = _Unchecked(_same)
