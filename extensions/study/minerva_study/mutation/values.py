"""New values of a type: random ones, or small changes of an old one."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, Final, TypeVar, cast

import numpy as np

from minerva_bus.grammar.scene import EMPTY, Scene, Value
from minerva_bus.grammar.text_and_digest import same_values
from minerva_bus.grammar.types import Type
from minerva_bus.portable import normal
from minerva_study.domains import Domain, Interval, OneOf

Stream = np.random.Generator
Inner = Callable[[Scene, Stream], Scene]
"""Mutation of a string that is the value of a parameter."""

_T = TypeVar("_T")

STEP: Final = 0.15
"""Standard deviation of a step, as a part of the range, or of the value if it has no range."""

AFRESH: Final = 0.1
"""Probability of drawing from the complete range, so that a search leaves local optima."""

_SCALES: Final = {"deg": 15.0, "deg/s": 15.0, "cm": 10.0, "mm": 100.0, "ms": 100.0, "g": 100.0}
_LEAST, _GREATEST = -(1 << 63), (1 << 63) - 1


def one_of(choices: Sequence[_T], chance: Stream) -> _T:
    """A random one of the choices."""
    return choices[int(chance.integers(len(choices)))]


def drawn(kind: Type, domain: Domain, chance: Stream) -> Value:
    """A value of a type, from its domain if it has one, otherwise a small value."""
    if isinstance(domain, OneOf):
        return one_of(domain.values, chance)
    if isinstance(domain, Interval):
        return _in_range(kind, domain, chance)
    return _DRAWN[kind.kind](kind, chance)


def _in_range(kind: Type, domain: Interval, chance: Stream) -> Value:
    if kind.kind == "int":
        low, high = int(domain.low), int(domain.high)
        return int(chance.integers(low, high, endpoint=True))
    return float(domain.nearest(domain.low + domain.width * chance.random()))


_DRAWN: dict[str, Callable[[Type, Stream], Any]] = {
    "bool": lambda kind, chance: bool(chance.random() < 0.5),
    "int": lambda kind, chance: int(chance.integers(0, 10)),
    "real": lambda kind, chance: normal(chance, _scale(kind)),
    "text": lambda kind, chance: one_of(kind.words, chance) if kind.words else "",
    "list": lambda kind, chance: (),
    "cells": lambda kind, chance: kind.fit(np.zeros((1, 1), np.int16)),
    "matrix": lambda kind, chance: kind.fit(np.zeros((1, 1))),
    "string": lambda kind, chance: EMPTY,
}


def perturbed(kind: Type, domain: Domain, value: Any, chance: Stream, inner: Inner) -> Value:
    """A value of the same type near another one; the same value if there is no other."""
    choice = domain.values if isinstance(domain, OneOf) else kind.words
    if choice:
        others = [item for item in choice if not same_values((item,), (value,))]
        return one_of(others, chance) if others else value
    if isinstance(domain, Interval) and chance.random() < AFRESH:
        return drawn(kind, domain, chance)
    if kind.kind == "bool":
        return not value
    if kind.kind == "int":
        return _whole(domain, value, chance)
    if kind.kind == "real":
        return _real(kind, domain, value, chance)
    if kind.kind == "list":
        return _listed(kind, cast("tuple[Any, ...]", value), chance, inner)
    if kind.kind in ("cells", "matrix"):
        return _matrix(kind, value, chance)
    return inner(value, chance) if kind.kind == "string" else value


def _real(kind: Type, domain: Domain, value: float, chance: Stream) -> float:
    if isinstance(domain, Interval):
        return float(domain.nearest(value + STEP * domain.width * normal(chance)))
    moved = value + max(STEP * abs(value), STEP * _scale(kind)) * normal(chance)
    # A step from a huge number may overflow.
    return float(moved) if math.isfinite(moved) else value


def _scale(kind: Type) -> float:
    return _SCALES.get(kind.unit, 1.0)


def _whole(domain: Domain, value: int, chance: Stream) -> int:
    width = domain.width if isinstance(domain, Interval) else abs(value)
    # Bounded, so that the step fits into 64 bits.
    step = int(chance.geometric(1.0 / (1.0 + min(STEP * width, 1e15))))
    moved = value + (step if chance.random() < 0.5 else -step)
    if isinstance(domain, Interval):
        moved = int(domain.nearest(moved))
    # An int of the language has 64 bits.
    return min(max(moved, _LEAST), _GREATEST)


def _listed(kind: Type, value: tuple[Any, ...], chance: Stream, inner: Inner) -> tuple[Any, ...]:
    """Change one item; the length remains, because other lists may have to match it."""
    if not value:
        return value
    at = int(chance.integers(len(value)))
    item = perturbed(cast("Type", kind.item), None, value[at], chance, inner)
    return (*value[:at], item, *value[at + 1 :])


def _matrix(kind: Type, value: Any, chance: Stream) -> Value:
    """Copy one cell of a matrix of cells to another, or change one number of a matrix."""
    if not value.size:
        return value
    changed = value.copy()
    at, other = chance.integers(value.size, size=2)
    if kind.kind == "cells":
        changed.flat[at] = value.flat[other]
    else:
        changed.flat[at] = _real(Type("real"), None, float(value.flat[at]), chance)
    return kind.fit(changed)
