"""Torus: birds turn in the direction of their neighbours; opposite edges of the plane touch."""

import numpy as np

from minerva_bus import Disc, EventType, World, on, portable, run, service
from minerva_study import Placed

eNear = EventType("eNear", number=int, dx=float, dy=float, vx=float, vy=float)  # means


class Bird(Placed, form=Disc(0.25, "#37618e", heading=True)):
    turn: float = 0.0  # degrees
    vx: float = 1.0
    vy: float = 0.0

    @on("eNear", population=True)
    def fly(self, near, moment):
        vx = self.vx + 0.3 * near.vx + 0.05 * near.dx + moment.chance.normal(0, 0.1)
        vy = self.vy + 0.3 * near.vy + 0.05 * near.dy + moment.chance.normal(0, 0.1)
        speed = np.sqrt(vx * vx + vy * vy) + 0.001
        self.vx, self.vy = vx / speed, vy / speed
        self.x, self.y = (self.x + 0.3 * self.vx) % 30, (self.y + 0.3 * self.vy) % 20
        self.turn = np.degrees(portable.atan2(self.vy, self.vx))


x, y, vx, vy = np.random.default_rng(1).uniform((0, 0, -1, -1), (30, 20, 1, 1), (200, 4)).T
near = service("neighbours", draws="ePicture", summary=True, radius=2.0, periodic=True,
               width=30.0, height=20.0)  # fmt: skip
world = World(Bird.many("b", 200, x=x, y=y, vx=vx, vy=vy), services=[near], name="birds")
run(world, frames=100, seed=1).picture().save("torus.svg")
