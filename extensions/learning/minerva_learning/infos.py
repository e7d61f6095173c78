"""Infos of a step: the frame, and the digest of the string, which is computed when it is read."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, cast


def _complete(name: str) -> Any:
    """A method of dictionaries that computes the digest before, unless it is about another key."""
    method, put = getattr(dict, name), cast("Any", dict).__setitem__

    def call(*args: Any, **kwargs: Any) -> Any:
        other = len(args) > 1 and isinstance(args[1], str) and args[1] != "digest"
        for info in () if other else args:  # Both sides of a comparison.
            digest = info.digest if isinstance(info, StepInfo) else None
            if digest is not None:
                put(info, "digest", digest())
                info.digest = None
        return method(*args, **kwargs)

    return call


class StepInfo(dict[str, Any]):
    """A dictionary whose entry `digest` is computed when it is read.

    In a small world, a digest takes up to a fifth of a step, and few learners read it. Until then
    the info keeps the string. Copies and pickles are plain dictionaries.
    """

    __slots__ = ("digest",)
    digest: Callable[[], Any] | None
    """Computes the digest; None if that is done."""

    @staticmethod
    def of(values: Mapping[str, Any], digest: Callable[[], Any]) -> StepInfo:
        """An info with these values, of which `digest` is replaced."""
        info = StepInfo(values)
        # Not by `__init__`, which takes longer than all else: there is an info for each agent.
        info.digest = digest
        return info

    __getitem__ = _complete("__getitem__")
    __setitem__ = _complete("__setitem__")
    __delitem__ = _complete("__delitem__")
    # A dictionary that is made of another one reads its values past these methods, unless it has
    # an iterator of its own.
    __iter__ = _complete("__iter__")
    __reversed__ = _complete("__reversed__")
    __eq__ = _complete("__eq__")
    __ne__ = _complete("__ne__")
    __or__ = _complete("__or__")
    __ror__ = _complete("__ror__")
    __ior__ = _complete("__ior__")
    __repr__ = _complete("__repr__")
    get = _complete("get")
    items = _complete("items")
    values = _complete("values")
    copy = _complete("copy")
    pop = _complete("pop")
    popitem = _complete("popitem")
    setdefault = _complete("setdefault")
    update = _complete("update")
    clear = _complete("clear")
    __hash__ = None  # pyright: ignore[reportAssignmentType]

    def __reduce__(self) -> Any:
        return dict, (self.copy(),)
