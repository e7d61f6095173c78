"""What goes wrong when the physics world is asked for something impossible."""

from __future__ import annotations

import math

from minerva_bus.errors import MinervaError


class PhysicsError(MinervaError, ValueError):
    """A place, a name, a number or a saved state that the physics world cannot use."""


def finite(what: str, *values: float) -> None:
    """Refuse numbers that would spread as NaN or infinity into every later pose.

    Raises:
        PhysicsError: one of the values is not finite; the message starts with `what`.

    """
    for value in values:
        if not math.isfinite(value):
            raise PhysicsError(f"{what}: expected finite numbers, found {value!r}")


def positive(what: str, value: float) -> None:
    """Refuse a size or a duration that is not a finite number above zero.

    Raises:
        PhysicsError: the value is zero, negative or not finite.

    """
    if not (math.isfinite(value) and value > 0):
        raise PhysicsError(f"{what}: expected a finite number above 0, found {value!r}")
