"""Colour by a value: plants take water from the ground, which is wet in the east."""

import numpy as np

from minerva_bus import Disc, World, each, on, run
from minerva_study import Placed


class Plant(Placed, form=Disc(0.4, "greens(water, 0, 10)")):
    water: float = 5.0

    @on("eStep", population=True)
    def live(self, step, moment):
        change = self.x / 20 - moment.chance.random()
        self.water = np.clip(self.water + change, 0, 10)


x, y = np.random.default_rng(1).uniform(0, 20, (2, 300))
world = World(Plant.many("p", 300, x=x, y=y), services=[each("eStep")], name="plants")
run(world, frames=40, seed=1).picture().save("colour.svg")
