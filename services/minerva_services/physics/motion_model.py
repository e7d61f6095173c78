"""The odometry motion model: errors of a robot's commands.

Thrun, Burgard and Fox, Probabilistic Robotics (2005), section 5.4, table 5.6 (sample_motion_model):
a step is a turn, a translation and a second turn, each with a normal error whose variance grows
with the squares of the commanded turn and translation:

  first turn   α1 turn² + α2 way²
  way          α3 way² + α4 turn²
  second turn  α2 way²               its command is 0 in this world

Variances apply per step. Errors of many steps partly cancel: over n equal steps the standard
deviation grows with √n, so shorter frames yield a more accurate robot.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np

from minerva_bus.portable import normals
from minerva_services.physics.errors import PhysicsError, finite


@dataclass(frozen=True, slots=True)
class DriveStep:
    """Turn in degrees, drive in metres, turn again in degrees."""

    turn_deg: float
    forward_m: float
    after_deg: float = 0.0


@dataclass(frozen=True, slots=True)
class MotionModel:
    """The four α, with turns in radians and distances in metres; all 0 means no error.

    Attributes:
        alpha1: turn error from turning.
        alpha2: turn error from driving, in rad²/m².
        alpha3: distance error from driving.
        alpha4: distance error from turning, in m²/rad².

    Raises:
        PhysicsError: a value is negative or not finite.

    """

    alpha1: float = 0.0
    alpha2: float = 0.0
    alpha3: float = 0.0
    alpha4: float = 0.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            finite(f"motion model, {field.name}", value)
            if value < 0:
                raise PhysicsError(
                    f"motion model, {field.name}: expected 0 or more, found {value!r}"
                )

    def __bool__(self) -> bool:
        return any(getattr(self, field.name) for field in fields(self))

    def sample(self, turn_deg: float, forward_m: float, rng: np.random.Generator) -> DriveStep:
        """A command as actually driven; a zero command has no error.

        Args:
            turn_deg: commanded turn in degrees.
            forward_m: commanded distance in metres.
            rng: consumes three normal values.

        """
        turn = math.radians(turn_deg)
        first, way, second = normals(rng, 3).tolist()
        turning = math.sqrt(self.alpha1 * turn * turn + self.alpha2 * forward_m * forward_m)
        driving = math.sqrt(self.alpha3 * forward_m * forward_m + self.alpha4 * turn * turn)
        swerving = math.sqrt(self.alpha2) * abs(forward_m)
        return DriveStep(
            turn_deg + math.degrees(turning * first),
            forward_m + driving * way,
            math.degrees(swerving * second),
        )
