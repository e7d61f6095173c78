"""Random numbers of rules, and what rules see that run as Python.

Random numbers are the methods of `moment.chance` as functions, with the same numbers. All rules of
a frame continue one stream, that of (seed, id of the space, frame).

Arrays of a rule are guarded: they refuse every index but those of rows or cells that exist. numpy
reads a negative index from the end of an array, and the arrays of a table have room for newborns
after its rows. A rule that computes an index, such as `i - 1` or the result of `beside`, must not
read or change those. Machine code refuses them, too; the rule then runs as Python.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Generator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, Final, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from minerva_bus.portable.distributions import (
    draw_chance,
    draw_exponential,
    draw_integers,
    draw_normal,
    draw_random,
    draw_uniform,
)

PLACE, TURNS, TURNS_IN_CALL = 0, 1, 2
"""Items of the `progress` of a kernel: the place of the current row in the order of activation, the
turns of its loops, and those of all rows in this call."""
MOST_TURNS: Final = 100_000_000
"""Turns of loops in a row, some tenths of a second, after which it runs in Python, which Ctrl-C can
interrupt."""

_F = TypeVar("_F", bound=Callable[..., Any])
_interpreting: ContextVar[bool] = ContextVar("interpreting", default=False)


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


def kernel(function: _F) -> _F:
    """Mark a function as one for rules, which may call it; they may call others, too.

    Example:
        >>> @kernel
        ... def hungry(sheep, i):
        ...     return sheep.energy[i] < 2.0

    """
    return function


def new_progress() -> NDArray[np.int64]:
    """The `progress` of a kernel that has not begun, shape (3,)."""
    return np.zeros(3, np.int64)


Draws: TypeAlias = NDArray[np.uint64]
"""A random stream, shape (1,); the parameter of a rule with this annotation."""
EMPTY_RANGE = "integers: no int is in this range; expected low < high"


def random(draws: Draws) -> float:
    """Uniform in [0, 1)."""
    return draw_random(draws, 0)


def uniform(draws: Draws, low: float = 0.0, high: float = 1.0) -> float:
    """Uniform in [low, high)."""
    return draw_uniform(draws, 0, low, high)


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


def chance(draws: Draws, probability: float) -> bool:
    """True with this probability."""
    return draw_chance(draws, 0, probability)


def exponential(draws: Draws, mean: float = 1.0) -> float:
    """Exponentially distributed, with this mean."""
    return draw_exponential(draws, 0, -mean)


def normal(draws: Draws, mean: float = 0.0, deviation: float = 1.0) -> float:
    """Normally distributed; takes two draws."""
    return draw_normal(draws, 0, mean, deviation)


def shuffle(draws: Draws, rows: NDArray[np.int64]) -> None:
    """Put rows into a random order (Fisher and Yates)."""
    for last in range(len(rows) - 1, 0, -1):
        other = integers(draws, 0, last + 1)
        row = rows[last]
        rows[last] = rows[other]
        rows[other] = row


ALL: Final = -1
"""In place of an item of `counts`: all items of the array exist."""
NO_INT: Final = "a rule has one int as index; write int(...) for a real"
READ_ONLY: Final = "an assignment to a matrix that stays as it is, such as `before`"
REAL_IN_CELLS: Final = "Cells are ints, and this is a real: write int(...), or use Reals"


EXACT: Final = 2**53
"""Ints up to this are reals without loss of digits."""
NO_REAL: Final = "an int beyond ±2^53 would lose digits as a real; write float(...) if it may"


class Guarded:
    """An array as a rule that runs as Python sees it.

    `slot` is the item of `counts` with the number of items that exist, or ALL.
    """

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
        elif not isinstance(value, float) and not -EXACT <= value <= EXACT:
            raise OverflowError(f"{value} in {self._name}[{index}]: {NO_REAL}")
        self._values[place] = value

    def _checked(self, index: Any) -> int:
        try:
            place = operator.index(index)
        except TypeError:
            raise TypeError(f"{self._name}[{index!r}]: {NO_INT}") from None
        if not 0 <= place < len(self):
            raise IndexError(f"{self._name}[{index}]: the index must be from 0 to {len(self) - 1}")
        return place
