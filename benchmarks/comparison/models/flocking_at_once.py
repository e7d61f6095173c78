"""Birds in Minerva Bus that all look at the flock as it was before the step."""

from __future__ import annotations

import numpy as np

from benchmarks.comparison.figures import of_flock
from benchmarks.comparison.models.flocking import Bird, Flock, flock, steer
from benchmarks.comparison.parameters import Flocking
from benchmarks.comparison.stepping import stepped
from minerva_bus import on
from minerva_fast import SIMULTANEOUS, rule


@rule(SIMULTANEOUS, births=0)
def fly_at_once(i: int, birds: Bird, before: Bird, sight: float, separation: float, cohere: float,
                separate: float, match: float, speed: float):  # fmt: skip
    steer(i, birds, before, sight, separation, cohere, separate, match, speed)


class FlockAtOnce(Flock, symbol="AFlock"):
    @on("eStep")
    def step(self, step, moment):
        self.run(moment, fly_at_once)


def run(p: Flocking, seed: int):
    """Run the model; returns the function that computes its statistics."""
    birds = flock(p, seed, FlockAtOnce)
    # In the order of their places, so that neighbours are close to each other in memory.
    x, y = Bird.read(birds.birds).x, Bird.read(birds.birds).y
    birds.birds = birds.birds[:, np.argsort(y // p.sight * p.side + x)]
    after = Bird.read(stepped(birds, p.steps, seed)["birds"])
    return lambda: of_flock(after.x, after.y, after.vx, after.vy)
