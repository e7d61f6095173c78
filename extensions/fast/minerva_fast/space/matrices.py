"""The matrices of a space while rules are applied to it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from minerva_fast.space.space import Space


class Matrices:
    """Cells of matrices in one dimension.

    A matrix is copied when the first rule that changes it starts. Rules that only read it before
    that get the memory of the string, as read-only arrays: for those, nothing that changes cells
    can be compiled.
    """

    def __init__(self, space: Space) -> None:
        self._space = space
        self._originals: dict[str, NDArray[Any]] = {}
        self._changing: dict[str, NDArray[Any]] = {}
        self._unchanged: dict[str, NDArray[Any]] = {}

    def to_change(self, name: str) -> NDArray[Any]:
        """The cells of a matrix, for rules that change it."""
        cells = self._changing.get(name)
        if cells is None:
            matrix: NDArray[Any] = getattr(self._space, name)
            writable: NDArray[Any] = self._space.writable(name)
            # The method may have written to the same array before its rules.
            self._originals[name] = matrix.copy() if writable is matrix else matrix
            cells = self._changing[name] = writable.reshape(-1)
        return cells

    def to_read(self, name: str) -> NDArray[Any]:
        """The cells of a matrix, for rules that only read it."""
        cells = self._changing.get(name)
        if cells is None:
            cells = self._unchanged.get(name)
        if cells is None:
            matrix: NDArray[Any] = getattr(self._space, name)
            if not is_constant(matrix):
                return self.to_change(name)
            cells = self._unchanged[name] = matrix.reshape(-1)
        return cells

    def as_it_is(self, name: str) -> NDArray[Any]:
        """Cells that stay as they are while rules change the matrix, for rules that read them."""
        matrix: NDArray[Any] = getattr(self._space, name)
        if name not in self._changing and is_constant(matrix):
            return self.to_read(name)
        cells = self.to_change(name).copy()
        cells.flags.writeable = False
        return cells

    def reset(self) -> None:
        """Give the space the matrices that it had before the rules."""
        for name, matrix in self._originals.items():
            setattr(self._space, name, matrix)


def is_constant(matrix: NDArray[Any]) -> bool:
    """Whether an array is a matrix of the string, with the layout that machine code takes."""
    plain = type(matrix) is np.ndarray and matrix.flags.c_contiguous and matrix.flags.aligned
    return plain and not matrix.flags.writeable
