"""Errors of the physics world."""

from __future__ import annotations

import math

from minerva_bus.errors import MinervaError


class PhysicsError(MinervaError, ValueError):
    """A position, name, number or saved state that the physics world cannot use."""


def finite(what: str, *values: float) -> None:
    """Reject numbers that would propagate as NaN or infinity into later poses.

    Raises:
        PhysicsError: a value is not finite; the message starts with `what`.

    """
    for value in values:
        if not math.isfinite(value):
            raise PhysicsError(f"{what}: expected finite numbers, found {value!r}")


def positive(what: str, value: float) -> None:
    """Reject a size or duration that is not a finite number above zero.

    Raises:
        PhysicsError: the value is zero, negative or not finite.

    """
    if not (math.isfinite(value) and value > 0):
        raise PhysicsError(f"{what}: expected a finite number above 0, found {value!r}")
