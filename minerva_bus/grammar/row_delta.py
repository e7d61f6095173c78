"""The rows that were removed from columns, and those that were added."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Rows = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class RowDelta:
    """Rows removed from columns of `count` rows, and rows added; the others keep their order.

    `gone` are ascending row numbers before the change, `born` ascending row numbers after it.
    """

    count: int
    gone: Rows
    born: Rows

    @property
    def after(self) -> int:
        """Number of rows after the change."""
        return self.count - len(self.gone) + len(self.born)

    @cached_property
    def source(self) -> Rows:
        """The old row of each new one, shape (after,); 0 for added rows, which have none."""
        stays = np.ones(self.count, np.bool_)
        stays[self.gone] = False
        old = np.ones(self.after, np.bool_)
        old[self.born] = False
        rows = np.zeros(self.after, np.intp)
        # The remaining rows keep their order, so both sides have them in the same one.
        rows[old] = np.flatnonzero(stays)
        return rows

    @staticmethod
    def of(was: Rows, count: int) -> RowDelta | None:
        """From the old row of each new one, -1 for added rows.

        None if the remaining rows are in another order, or if no old row remains.
        """
        stays = was[was >= 0]
        if not len(stays) or (stays[1:] <= stays[:-1]).any():
            return None
        gone = np.ones(count, np.bool_)
        gone[stays] = False
        return RowDelta(count, np.flatnonzero(gone), np.flatnonzero(was < 0))
