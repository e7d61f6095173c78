"""Dataclasses that coordinator and members pass to each other: messages, stimuli, instructions."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TypeVar, dataclass_transform

_T = TypeVar("_T")


@dataclass_transform(frozen_default=True, field_specifiers=(field,))
def fast_dataclass(cls: type[_T]) -> type[_T]:
    """Make a class an immutable dataclass with slots; the type checker refuses to change objects.

    Python does not: a class that is frozen at run time sets each field by a call, which takes five
    times as long, and a frame makes a dozen of these objects.
    """
    return dataclass(slots=True, unsafe_hash=True)(cls)
