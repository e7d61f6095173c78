"""Repeated concatenation of the same parts, with a cache of the result."""

from __future__ import annotations

from collections.abc import Sequence
from operator import is_
from typing import Any, Self


class Joinable:
    """Base of columns. The first of several parts caches the result of joining them."""

    __slots__ = ("_joined",)

    def __init__(self) -> None:
        self._joined: tuple[tuple[Any, ...], Any] | None = None

    @classmethod
    def concatenated(cls, parts: Sequence[Self]) -> Self:
        """Several columns as one."""
        first, others = parts[0], tuple(parts[1:])
        if not others:
            return first
        # The slices of a population are joined in every frame. If none has changed, the result is
        # the same object, with its digests.
        known = first._joined
        if known is None or len(known[0]) != len(others) or not all(map(is_, known[0], others)):
            known = first._joined = others, cls._in_one(parts)
        return known[1]

    @classmethod
    def _in_one(cls, parts: Sequence[Any]) -> Self:
        raise NotImplementedError
