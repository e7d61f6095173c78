"""Batch: one call of a method moves all 10,000 walkers, because their attributes are arrays."""

import numpy as np

from minerva_bus import Disc, World, each, on, run
from minerva_study import Placed


class Walker(Placed, form=Disc(0.2, "inferno(steps, 30, 55)")):
    steps: int = 0

    @on("eStep", population=True)  # With one agent for each call, drop population=True.
    def walk(self, step, moment):
        goes = moment.chance.chance(0.7)
        self.x += goes * moment.chance.normal(0, 0.5)
        self.y += goes * moment.chance.normal(0, 0.5)
        self.steps += goes


x, y = np.random.default_rng(1).normal(0, 3, (2, 10_000))
walkers = Walker.many("w", 10_000, x=x, y=y)
run(World(walkers, services=[each("eStep")], name="walkers"), frames=60).picture().save("batch.svg")
