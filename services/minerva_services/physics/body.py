"""A round body, where it is, and what became of its commands."""

from __future__ import annotations

import math
from dataclasses import dataclass

from minerva_bus import portable
from minerva_services.physics.encounters import Course
from minerva_services.physics.sweep import Point
from minerva_services.physics.touch import Contact


@dataclass(frozen=True, slots=True)
class Pose:
    """A place and a heading.

    Attributes:
        x: in metres.
        y: in metres.
        angle: in degrees, counter-clockwise from +x; a plain sum of turns, never wrapped.

    """

    x: float
    y: float
    angle: float


@dataclass(frozen=True, slots=True)
class Command:
    """What a body is told to do in one step: turn on the spot, then drive straight.

    Attributes:
        turn_deg: in degrees, counter-clockwise.
        forward_m: in metres along the new heading; negative is backwards.

    """

    turn_deg: float
    forward_m: float


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a command came to.

    Attributes:
        name: the body's name.
        moved_m: the distance driven in metres along the heading; negative is backwards.
        shortfall_m: the metres that were commanded and not driven, never negative.
        turned_deg: the turn made in degrees.
        collided: something stopped the move before its end.
        contact: where, and what it was, if something did.

    """

    name: str
    moved_m: float
    shortfall_m: float
    turned_deg: float
    collided: bool
    contact: Contact | None = None


@dataclass(frozen=True, slots=True)
class Odometer:
    """What a body has done since it was added.

    Attributes:
        driven_m: metres driven, backwards as well as forwards.
        collisions: steps in which a commanded move was stopped.

    """

    driven_m: float = 0.0
    collisions: int = 0


@dataclass(frozen=True, slots=True)
class Body:
    """A disc with a heading.

    Attributes:
        pose: of its centre.
        radius: in metres.
        odometer: what it has done.

    """

    pose: Pose
    radius: float
    odometer: Odometer = Odometer()

    @property
    def centre(self) -> Point:
        """The place, x and y in metres."""
        return self.pose.x, self.pose.y

    def turned(self, turn_deg: float) -> Body:
        """The body after a turn on the spot."""
        pose = Pose(self.pose.x, self.pose.y, self.pose.angle + turn_deg)
        return Body(pose, self.radius, self.odometer)

    def course(self, forward_m: float) -> Course:
        """The line that the body means to drive along its heading."""
        heading = math.radians(self.pose.angle)
        move = forward_m * portable.cos(heading), forward_m * portable.sin(heading)
        return Course(self.centre, move, self.radius)

    def driven(self, moved_m: float, *, collided: bool) -> Body:
        """The body after a drive, at exactly the place that dead reckoning gives."""
        heading = math.radians(self.pose.angle)
        x = self.pose.x + moved_m * portable.cos(heading)
        y = self.pose.y + moved_m * portable.sin(heading)
        odometer = Odometer(
            self.odometer.driven_m + abs(moved_m), self.odometer.collisions + collided
        )
        return Body(Pose(x, y, self.pose.angle), self.radius, odometer)
