"""Functions of numbers and arrays, composed of a form for each.

Both forms have the same bits for the same number.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any, Final, Protocol, TypeVar, cast, overload

import numpy as np
from numpy.typing import NDArray

Numbers = NDArray[np.float64]
Bits = NDArray[np.int64]

F = TypeVar("F", float, Numbers)
"""Type of kernels, which accept numbers and arrays, because they use + - * / only."""

_BLOCK: Final = 4096
"""Length of blocks of arrays, whose intermediate results fit into the processor's cache."""

FEW: Final = 16
"""Up to this length, arrays are computed number by number: a call of numpy takes longer."""

_HEAD: Final = 2.0**32 + 1


class Unary(Protocol):
    """A function of a number, or of each number of an array."""

    @overload
    def __call__(self, x: float, /) -> float: ...
    @overload
    def __call__(self, x: NDArray[Any], /) -> Numbers: ...


class Binary(Protocol):
    """A function of two numbers, or of two arrays that are broadcast against each other."""

    @overload
    def __call__(self, x: float, y: float, /) -> float: ...
    @overload
    def __call__(self, x: NDArray[Any], y: NDArray[Any] | float, /) -> Numbers: ...
    @overload
    def __call__(self, x: float, y: NDArray[Any], /) -> Numbers: ...


class Twofold(Protocol):
    """A function with two results for a number, or for each number of an array."""

    @overload
    def __call__(self, x: float, /) -> tuple[float, float]: ...
    @overload
    def __call__(self, x: NDArray[Any], /) -> tuple[Numbers, Numbers]: ...


def unary(scalar: Callable[[float], float], arrays: Callable[[Numbers], Numbers]) -> Unary:
    """The function with a form for one number and a form for an array of one axis."""

    def function(x: Any, /) -> Any:
        if isinstance(x, np.ndarray):
            return _all(scalar, arrays, cast("NDArray[Any]", x))
        return scalar(float(x))

    return cast("Unary", _named(function, scalar))


def twofold(
    scalar: Callable[[float], tuple[float, float]],
    arrays: Callable[[Numbers], tuple[Numbers, Numbers]],
) -> Twofold:
    """The function of two results with a form for a number and a form for an array of one axis."""

    def function(x: Any, /) -> Any:
        if isinstance(x, np.ndarray):
            return tuple(_all(scalar, arrays, cast("NDArray[Any]", x), results=(2,)))
        return scalar(float(x))

    return cast("Twofold", _named(function, scalar))


def binary(
    scalar: Callable[[float, float], float], arrays: Callable[[Numbers, Numbers], Numbers]
) -> Binary:
    """The function of two arguments with a form for numbers and a form for arrays of one axis."""

    def function(x: Any, y: Any, /) -> Any:
        if isinstance(x, np.ndarray) or isinstance(y, np.ndarray):
            return _all(scalar, arrays, *np.broadcast_arrays(cast("Any", x), cast("Any", y)))
        return scalar(float(x), float(y))

    return cast("Binary", _named(function, scalar))


def _named(function: Callable[..., Any], scalar: Callable[..., Any]) -> Callable[..., Any]:
    function.__name__ = function.__qualname__ = scalar.__name__.removesuffix("_one").removeprefix(
        "_"
    )
    function.__doc__, function.__module__ = scalar.__doc__, scalar.__module__
    # The form that compiled code calls.
    vars(function)["one"] = scalar
    return function


def _all(
    scalar: Callable[..., Any],
    function: Callable[..., Any],
    *arrays: NDArray[Any],
    results: tuple[int, ...] = (),
) -> Numbers:
    """The results for all elements of arrays of one shape; of several, the first axis."""
    if arrays[0].size <= FEW:
        flat = [np.asarray(array, np.float64).ravel().tolist() for array in arrays]
        # For what a number has no result, an array has inf or nan.
        with suppress(ValueError, OverflowError):
            made = np.array(list(map(scalar, *flat)), np.float64).reshape((-1, *results))
            return made.T.reshape((*results, *arrays[0].shape))
    return _in_blocks(function, *arrays, results=results)


def _in_blocks(
    function: Callable[..., Any], *arrays: NDArray[Any], results: tuple[int, ...]
) -> Numbers:
    """The results of a form for arrays of one axis; arrays of one shape, block by block."""
    flat = [np.asarray(array, np.float64).ravel() for array in arrays]
    count = len(flat[0])
    made = np.empty((*results, count))
    # The forms compute all branches for all elements, including those that are not taken.
    with np.errstate(all="ignore"):
        for start in range(0, count, _BLOCK):
            end = start + _BLOCK
            made[..., start:end] = function(*(array[start:end] for array in flat))
    return made.reshape((*results, *arrays[0].shape))


def head(x: F) -> F:
    """The upper 21 bits of numbers below 2^990: products of two heads are exact."""
    # Veltkamp's split: the rounding of the product with 2^32 + 1 leaves 53 - 32 bits.
    wide = x * _HEAD
    return wide - (wide - x)
