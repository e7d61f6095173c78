"""What becomes of a robot's commands: the odometry motion model.

Thrun, Burgard and Fox, Probabilistic Robotics (2005), section 5.4, table 5.6 (sample_motion_model):
a step is a turn, a way and a second turn, and each of them errs by a normal error whose variance
grows with the squares of the turn and the way:

    first turn   α1 turn² + α2 way²
    way          α3 way² + α4 turn²
    second turn  α2 way²               its command is 0 in this world

Variances are those of one step. The errors of many steps partly cancel: over n like steps the
standard deviation grows with the root of n, so shorter frames make a better robot of it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np

from minerva_bus.portable import normals
from minerva_services.physics.errors import PhysicsError, finite


@dataclass(frozen=True, slots=True)
class Step:
    """Turn in degrees, drive in metres, turn again in degrees."""

    turn_deg: float
    forward_m: float
    after_deg: float = 0.0


@dataclass(frozen=True, slots=True)
class MotionModel:
    """The four α, with turns in radians and ways in metres; all 0: commands are carried out.

    Attributes:
        alpha1: of turns by turning.
        alpha2: of turns by driving, in rad²/m².
        alpha3: of ways by driving.
        alpha4: of ways by turning, in m²/rad².

    Raises:
        PhysicsError: one is negative or not finite.

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

    def sample(self, turn_deg: float, forward_m: float, rng: np.random.Generator) -> Step:
        """A command as it is carried out; who is told to do nothing does nothing.

        Args:
            turn_deg: the turn of the command in degrees.
            forward_m: its way in metres.
            rng: three normal values are drawn from it.

        """
        turn = math.radians(turn_deg)
        first, way, second = normals(rng, 3).tolist()
        turning = math.sqrt(self.alpha1 * turn * turn + self.alpha2 * forward_m * forward_m)
        driving = math.sqrt(self.alpha3 * forward_m * forward_m + self.alpha4 * turn * turn)
        swerving = math.sqrt(self.alpha2) * abs(forward_m)
        return Step(
            turn_deg + math.degrees(turning * first),
            forward_m + driving * way,
            math.degrees(swerving * second),
        )
