"""Birds in Minerva Bus."""

from __future__ import annotations

import math

import numpy as np

from benchmarks.comparison.figures import of_flock
from benchmarks.comparison.parameters import Flocking
from benchmarks.comparison.stepping import stepped
from minerva_bus import Reals, on
from minerva_fast import SHUFFLED, Column, InField, Space, go_to, kernel, near, rule


class Bird(InField):
    vx: Column
    vy: Column


@rule(SHUFFLED, births=0)
def fly(i: int, birds: Bird, sight: float, separation: float, cohere: float, separate: float,
        match: float, speed: float):  # fmt: skip
    steer(i, birds, birds, sight, separation, cohere, separate, match, speed)


@kernel
def steer(i, birds, seen, sight, separation, cohere, separate, match, speed):
    vx = vy = 0.0
    count = near(seen, seen.x[i], seen.y[i], sight, i)
    for k in range(count):
        j, dx, dy = seen.nearby[k], seen.dx[k], seen.dy[k]
        vx += cohere * dx + match * seen.vx[j]
        vy += cohere * dy + match * seen.vy[j]
        if dx * dx + dy * dy < separation * separation:
            vx -= separate * dx
            vy -= separate * dy
    vx = birds.vx[i] + vx / max(count, 1)
    vy = birds.vy[i] + vy / max(count, 1)
    length = math.sqrt(vx * vx + vy * vy)
    birds.vx[i], birds.vy[i] = vx / length, vy / length
    go_to(birds, i, birds.x[i] + speed * birds.vx[i], birds.y[i] + speed * birds.vy[i])


class Flock(Space, symbol="AFlock"):
    birds: Reals
    sight: float
    separation: float
    cohere: float
    separate: float
    match: float
    speed: float

    @on("eStep")
    def step(self, step, moment):
        self.run(moment, fly)


def run(p: Flocking, seed: int):
    """Run the model; returns the function that computes its statistics."""
    birds = Bird.read(stepped(flock(p, seed), p.steps, seed)["birds"])
    return lambda: of_flock(birds.x, birds.y, birds.vx, birds.vy)


def flock(p: Flocking, seed: int, kind: type[Flock] = Flock) -> Flock:
    random = np.random.default_rng(seed)
    x, y = random.uniform(0, p.side, (2, p.birds))
    vx, vy = random.uniform(-1, 1, (2, p.birds))
    return kind(
        "flock",
        width=p.side,
        height=p.side,
        periodic=True,
        births=p.birds,
        birds=Bird.many(p.birds, x=x, y=y, vx=vx, vy=vy),
        sight=p.sight,
        separation=p.separation,
        cohere=p.cohere,
        separate=p.separate,
        match=p.match,
        speed=p.speed,
    )
