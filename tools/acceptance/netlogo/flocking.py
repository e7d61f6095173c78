"""Flocking (Wilensky 1998) as in Mesa: birds turn by cohesion, separation and alignment."""

import math

import numpy as np

from minerva_bus import Reals, on
from minerva_fast import SHUFFLED, Column, InField, Space, go_to, near, rule
from tools.acceptance.netlogo.primitives import ticking

SIDE, BIRDS, SIGHT, SEPARATION = 100.0, 100, 10.0, 2.0


class Bird(InField):
    vx: Column
    vy: Column


@rule(SHUFFLED)
def fly(i: int, birds: Bird):
    vx = vy = 0.0
    count = near(birds, birds.x[i], birds.y[i], SIGHT, i)
    for k in range(count):
        j, dx, dy = birds.nearby[k], birds.dx[k], birds.dy[k]
        apart = 0.015 if dx * dx + dy * dy < SEPARATION * SEPARATION else 0.0
        vx += (0.03 - apart) * dx + 0.05 * birds.vx[j]
        vy += (0.03 - apart) * dy + 0.05 * birds.vy[j]
    if count > 0:
        vx, vy = birds.vx[i] + vx / count, birds.vy[i] + vy / count
        speed = math.sqrt(vx * vx + vy * vy)
        birds.vx[i], birds.vy[i] = vx / speed, vy / speed
    go_to(birds, i, birds.x[i] + birds.vx[i], birds.y[i] + birds.vy[i])


class Flock(Space, symbol="AFlock"):
    birds: Reals

    @on("eStep")
    def step(self, step, moment):
        self.run(moment, fly)


def world(seed):
    random = np.random.default_rng(seed)
    (x, y), (vx, vy) = random.uniform(0, SIDE, (2, BIRDS)), random.uniform(-1, 1, (2, BIRDS))
    flock = Flock("flock", width=SIDE, height=SIDE, periodic=True, births=BIRDS,
                  birds=Bird.many(BIRDS, x=x, y=y, vx=vx, vy=vy))  # fmt: skip
    return ticking(flock)


def shown(state):
    """Positions and directions."""
    birds = Bird.read(state["birds"])
    return birds.x, birds.y, birds.vx, birds.vy
