"""The ids of a population with births as a table that only grows.

A column of ids is then one number per row, its entry in the table. A birth adds an entry, so a
frame with births and deaths moves numbers, and handles the texts of newborns alone.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from minerva_bus.grammar.places import Hashes, Places, Rows

Texts = NDArray[np.bytes_]
Entries = NDArray[np.intp]

SPARE: Final = 256
"""A table may have this many entries of dead agents beyond the number of living ones."""


class IdPool:
    """Ids with different hashes, each once; ids are added and never removed.

    Different hashes show that ids differ. So equal entries mean equal ids, and vice versa.
    """

    def __init__(self, texts: Texts, hashes: Hashes) -> None:
        self._texts = texts
        self._hashes = hashes
        self._places = Places(hashes)
        self.count = len(texts)

    @staticmethod
    def of(texts: Texts, hashes: Hashes) -> IdPool | None:
        """A table of these ids, n > 0; None if two of them have the same hash."""
        ordered = np.sort(hashes)
        return None if (ordered[1:] == ordered[:-1]).any() else IdPool(texts, hashes)

    def texts(self, entries: Any) -> Any:
        """The ids of some entries, or of one."""
        return self._texts[entries]

    def hashes(self, entries: Entries) -> Hashes:
        """The hashes of some entries."""
        return self._hashes[entries]

    def crowded(self, agents: int) -> bool:
        """Whether too many entries belong to no agent; a new table then takes less memory."""
        return self.count > 2 * agents + SPARE

    def find(self, texts: Texts, hashes: Hashes) -> Rows:
        """The entry of each id, -1 if it is not here; shape (n,)."""
        entries = self._places.rows_of(hashes)
        here = np.flatnonzero(entries >= 0)
        # Equal hashes do not prove equal ids. No other entry has this hash.
        other = self._texts[entries[here]] != texts[here]
        entries[here[other]] = -1
        return entries

    def add(self, texts: Texts, hashes: Hashes) -> Rows | None:
        """The entry of each id, added if necessary; None if that would repeat an id or a hash."""
        if not len(texts):
            return np.empty(0, np.intp)
        entries = self._places.rows_of(hashes)
        here = entries >= 0
        if here.any() and (self._texts[entries[here]] != texts[here]).any():
            return None
        ordered = np.sort(hashes)
        if (ordered[1:] == ordered[:-1]).any():
            return None
        new = np.flatnonzero(~here)
        if len(new):
            entries[new] = np.arange(self.count, self.count + len(new))
            self._append(texts[new], hashes[new])
        return entries

    def _append(self, texts: Texts, hashes: Hashes) -> None:
        begin, self.count = self.count, self.count + len(texts)
        # Earlier views of both arrays stay valid, because what they show never changes.
        self._texts = _with(self._texts, begin, texts)
        self._hashes = _with(self._hashes, begin, hashes)
        self._places.extend(self._hashes[: self.count], begin)


def _with(array: NDArray[Any], count: int, more: NDArray[Any]) -> NDArray[Any]:
    """An array with other values after its first `count`; spare room for later ones is left."""
    dtype = np.promote_types(array.dtype, more.dtype)
    end = count + len(more)
    if end > len(array) or dtype != array.dtype:
        larger = np.empty(max(end + end // 4, len(array)), dtype)
        larger[:count] = array[:count]
        array = larger
    array[count:end] = more
    return array
