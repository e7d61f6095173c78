"""Size by a value: bubbles grow until they are a metre wide, and begin again."""

import numpy as np

from minerva_bus import Disc, World, each, on, run
from minerva_study import Placed


class Bubble(Placed, form=Disc("radius", "#56b4e9")):
    radius: float = 0.1

    @on("eStep", population=True)
    def grow(self, step, moment):
        self.radius *= moment.chance.uniform(1.0, 1.1)
        self.radius = np.where(self.radius > 0.5, 0.1, self.radius)


x, y = np.random.default_rng(2).uniform(0, 20, (2, 200))
world = World(Bubble.many("b", 200, x=x, y=y), services=[each("eStep")], name="bubbles")
run(world, frames=50, seed=1).picture().save("size.svg")
