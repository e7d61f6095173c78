"""Robots that drive along a corridor with pillars, with a laser (extensions/learning/rl.md)."""

import math
from typing import Annotated

import numpy as np

from minerva_bus import (
    Agent,
    Degrees,
    Disc,
    EventType,
    Metres,
    Motion,
    Primitive,
    Range,
    Transformation,
    World,
    each,
    on,
    portable,
    view,
)

WIDTH, SPEED, REACH = 8.0, 0.2, 6.0
PILLAR, ROBOT = 0.7, 0.3
ANGLES = (-75, -45, -20, 0, 20, 45, 75)
PILLARS = np.array([(6 + 3.0 * n, 1 + (3.7 * n) % 6) for n in range(24)])

PRobot = Primitive("PRobot", Disc("radius", "#37618e", heading=True), radius=Metres)
TPlace = Transformation("TPlace", Motion("x", "y", "angle"), x=Metres, y=Metres, angle=Degrees)
eStep = EventType("eStep")
eSteer = EventType("eSteer", turn=Annotated[Degrees, Range(-20, 20)])
ePicture = EventType("ePicture", visual=True)


class Robot(Agent, symbol="ARobot"):
    """Drives on, measures distances, and is out of order after a collision."""

    x: Metres
    y: Metres
    heading: Degrees = 0.0
    beam0: Metres = REACH
    beam1: Metres = REACH
    beam2: Metres = REACH
    beam3: Metres = REACH
    beam4: Metres = REACH
    beam5: Metres = REACH
    beam6: Metres = REACH

    @on("eSteer", population=True)
    def steer(self, steer, moment):
        self.heading += steer.turn

    @on("eStep", population=True)
    def drive(self, step, moment):
        turn = self.heading * (math.pi / 180)
        self.x, self.y = self.x + SPEED * portable.cos(turn), self.y + SPEED * portable.sin(turn)
        far = PILLARS - np.stack([self.x, self.y], 1)[:, None]
        near = (far**2).sum(2).min(1) < (PILLAR + ROBOT) ** 2
        self.die(near | (self.y < ROBOT) | (self.y > WIDTH - ROBOT))
        noise = 1 + 0.02 * moment.chance.normal()
        for number, angle in enumerate(ANGLES):
            measured = noise * distances(far, self.y, turn + math.radians(angle))
            setattr(self, f"beam{number}", np.minimum(measured, REACH))

    @view("ePicture", population=True)
    def picture(self, event):
        return TPlace(self.x, self.y, self.heading)(PRobot(ROBOT))


def distances(far, y, direction):
    """The distance to the next pillar or wall in a direction, shape (n,).

    `far` is the way to each pillar, shape (n, pillars, 2); `direction` is in radians.
    """
    dx, dy = portable.cos(direction), portable.sin(direction)
    along = far[..., 0] * dx[:, None] + far[..., 1] * dy[:, None]
    inside = PILLAR**2 - ((far**2).sum(2) - along**2)
    hit = (along > 0) & (inside > 0)
    pillars = np.where(hit, along - np.sqrt(np.maximum(inside, 0)), REACH).min(1)
    slope = np.where(np.abs(dy) < 1e-9, 1e-9, dy)
    walls = np.where(slope > 0, WIDTH - y, -y) / slope
    return np.minimum(pillars, walls)


def robots(options):
    """Robots at the beginning of the corridor, side by side."""
    count = options["robots"]
    return Robot.many("r", count, x=1.0, y=1 + (WIDTH - 2) * (np.arange(count) + 0.5) / count)


world = World(
    robots,
    agents=[Robot],
    services=[each(eStep)],
    symbols=[eSteer, PRobot, TPlace, ePicture],
    options={"robots": 48},
    order=[eSteer, eStep],
    name="corridor",
)
