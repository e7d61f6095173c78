"""A round body: pose, command, outcome, odometer, and its state as plain numbers."""

from __future__ import annotations

import math

from minerva_bus import portable
from minerva_bus.semantics.poses import Pose
from minerva_bus.values import fast_dataclass
from minerva_services.physics.encounters import Contact, MovingDisc, Point
from minerva_services.physics.errors import finite, positive


@fast_dataclass
class DriveCommand:
    """A body's command for one step: turn on the spot, then drive straight.

    Attributes:
        turn_deg: in degrees, counter-clockwise.
        forward_m: in metres along the new heading; negative is backwards.

    """

    turn_deg: float = 0.0
    forward_m: float = 0.0


@fast_dataclass
class DriveOutcome:
    """The outcome of a command.

    Attributes:
        name: the body's name.
        moved_m: distance driven in metres along the heading; negative is backwards.
        shortfall_m: commanded distance that was not driven, in metres, >= 0.
        turned_deg: the turn in degrees.
        collided: whether the move was stopped early.
        contact: where and by what, if it was.

    """

    name: str
    moved_m: float
    shortfall_m: float
    turned_deg: float
    collided: bool
    contact: Contact | None = None


@fast_dataclass
class Odometer:
    """What a body has done since it was added.

    Attributes:
        driven_m: metres driven, forwards and backwards.
        collisions: steps in which a commanded move was stopped.

    """

    driven_m: float = 0.0
    collisions: int = 0


@fast_dataclass
class Body:
    """A disc with a heading.

    Attributes:
        pose: of its centre; the angle is the plain sum of all turns, never wrapped.
        radius: in metres.
        odometer: what it has done.

    """

    pose: Pose
    radius: float
    odometer: Odometer = Odometer()

    @property
    def centre(self) -> Point:
        """Position (x, y) in metres."""
        return self.pose.x, self.pose.y

    def turned(self, turn_deg: float) -> Body:
        """The body after a turn on the spot."""
        pose = Pose(self.pose.x, self.pose.y, self.pose.angle + turn_deg)
        return Body(pose, self.radius, self.odometer)

    def course(self, forward_m: float) -> MovingDisc:
        """The displacement along the heading that a command asks for."""
        cos, sin = portable.cos_sin(math.radians(self.pose.angle))
        return MovingDisc(self.centre, (forward_m * cos, forward_m * sin), self.radius)

    def driven(self, moved_m: float, *, collided: bool) -> Body:
        """The body after driving, at exactly the position given by dead reckoning."""
        cos, sin = portable.cos_sin(math.radians(self.pose.angle))
        # Not `course(...).at(...)`, which multiplies in another order and therefore rounds
        # differently from the dead reckoning that `Arena.step` promises.
        x, y = self.pose.x + moved_m * cos, self.pose.y + moved_m * sin
        odometer = Odometer(
            self.odometer.driven_m + abs(moved_m), self.odometer.collisions + collided
        )
        return Body(Pose(x, y, self.pose.angle), self.radius, odometer)


def row_of(body: Body) -> list[float]:
    """x, y (m), angle (deg), radius (m), driven (m), collisions."""
    pose, odometer = body.pose, body.odometer
    return [pose.x, pose.y, pose.angle, body.radius, odometer.driven_m, odometer.collisions]


def body_of(row: list[float]) -> Body:
    """Inverse of `row_of`. Raises PhysicsError, TypeError or ValueError for other values."""
    x, y, angle, radius, driven, collisions = map(float, row)
    finite("saved state, a body", x, y, angle, driven, collisions)
    positive("saved state, a radius in metres", radius)
    return Body(Pose(x, y, angle), radius, Odometer(driven, int(collisions)))
