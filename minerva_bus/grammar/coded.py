"""Texts of a column as numbers of different texts, so that few texts are compared and checked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

_PART: Final = 4
"""A selection of rows keeps the table of words if it has this many times as many rows."""


@dataclass(frozen=True, slots=True, eq=False)
class Coded:
    """n texts: text k is `words[codes[k]]`. The words differ; some may have no row.

    Both arrays have one dimension, of objects and of int64, and nobody writes to them.
    """

    words: NDArray[Any]
    codes: NDArray[np.int64]

    @staticmethod
    def of(texts: NDArray[Any]) -> Coded:
        """The codes of an array of texts."""
        listed = texts.tolist()
        numbers = {text: number for number, text in enumerate(dict.fromkeys(listed))}
        return Coded(_array(list(numbers)), _looked_up(numbers, listed))

    def __len__(self) -> int:
        return len(self.codes)

    def texts(self) -> NDArray[Any]:
        """The texts, as an array of objects."""
        return self.words[self.codes]

    def used(self) -> Coded:
        """The same texts without words that have no row."""
        used = np.bincount(self.codes, minlength=len(self.words)) > 0
        if used.all():
            return self
        return Coded(self.words[used], (np.cumsum(used) - 1)[self.codes])

    def take(self, rows: NDArray[np.intp] | slice) -> Coded | None:
        """The texts of some rows; None if these are few beside the words."""
        codes = self.codes[rows]
        return Coded(self.words, codes) if _PART * len(self.words) <= len(codes) else None

    def put(self, rows: NDArray[np.intp], others: Coded) -> Coded:
        """The texts with others in some rows."""
        whole = Coded.joined([self, others])
        codes = whole.codes[: len(self)].copy()
        codes[rows] = whole.codes[len(self) :]
        return Coded(whole.words, codes)

    def differs(self, other: Coded) -> NDArray[np.intp]:
        """The rows in which as many other texts differ."""
        if self.words is other.words:
            return np.flatnonzero(self.codes != other.codes)
        numbers = {word: number for number, word in enumerate(self.words.tolist())}
        own = np.array([numbers.get(word, -1) for word in other.words.tolist()], np.int64)
        return np.flatnonzero(self.codes != own[other.codes])

    @staticmethod
    def joined(parts: Sequence[Coded]) -> Coded:
        """The texts of all parts, one after another."""
        numbers: dict[str, int] = {}
        made: list[NDArray[np.int64]] = []
        for part in parts:
            words = part.words.tolist()
            for word in words:
                numbers.setdefault(word, len(numbers))
            made.append(_looked_up(numbers, words)[part.codes])
        return Coded(_array(list(numbers)), np.concatenate(made))


def _array(texts: Sequence[str]) -> NDArray[Any]:
    array = np.empty(len(texts), object)
    array[:] = texts
    return array


def _looked_up(numbers: dict[str, int], texts: Sequence[str]) -> NDArray[np.int64]:
    # Without a step of Python for each text.
    return np.fromiter(map(numbers.__getitem__, texts), np.int64, len(texts))
