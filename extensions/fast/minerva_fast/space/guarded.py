"""Arrays of a rule that refuse every index but those of rows or cells that exist.

numpy and numba read a negative index from the end of an array, and the arrays of a table have room
for newborns after its rows. A rule that computes an index, such as `i - 1` or the result of
`beside`, must not read or change those.
"""

from __future__ import annotations

import operator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from minerva_fast.space.kernels import Kernel

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
        from minerva_fast.space.machine import guard

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
        from minerva_fast.space import machine

        return machine.unchecked


def _same(array: Any) -> Any:
    """An array without index checks, for kernels whose indices are known to exist.

    In rules that run as Python it is the same array, which checks them.
    """
    return array


unchecked: Final = _Unchecked(_same)
