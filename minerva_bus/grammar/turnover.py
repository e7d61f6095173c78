"""Deaths and births in columns: which rows stay, in their order, and where new ones are."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Rows = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class RowDelta:
    """`count` rows become others: those `gone` are no more, those `born` were not there before.

    `gone` are rising row numbers of the old, `born` rising ones of the new.
    """

    count: int
    gone: Rows
    born: Rows

    @property
    def after(self) -> int:
        """How many rows there are then."""
        return self.count - len(self.gone) + len(self.born)

    @cached_property
    def source(self) -> Rows:
        """The old row of each new one, shape (after,); of those born row 0, which says nothing."""
        stays = np.ones(self.count, np.bool_)
        stays[self.gone] = False
        old = np.ones(self.after, np.bool_)
        old[self.born] = False
        rows = np.zeros(self.after, np.intp)
        rows[old] = np.flatnonzero(stays)
        return rows

    @staticmethod
    def of(was: Rows, count: int) -> RowDelta | None:
        """By the old row of each new one, -1 where it was not there.

        None where they are not in their order any more, or none of them is there.
        """
        stays = was[was >= 0]
        if not len(stays) or (stays[1:] <= stays[:-1]).any():
            return None
        gone = np.ones(count, np.bool_)
        gone[stays] = False
        return RowDelta(count, np.flatnonzero(gone), np.flatnonzero(was < 0))
