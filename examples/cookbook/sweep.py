"""Sweep: how much of a forest burns down, by the number of its trees."""

import numpy as np

from minerva_bus import EventType, World, on, service
from minerva_study import Placed, sweep

eNear = EventType("eNear", sum_burns=float)


class Tree(Placed):
    burns: bool = False
    burnt: bool = False

    @on("eNear", population=True)
    def burn(self, near, moment):
        self.burnt |= self.burns
        self.burns = (near.sum_burns > 0) & ~self.burnt


def forest(options):
    x, y = np.random.default_rng(1).uniform(0, 50, (2, options["trees"]))
    return Tree.many("t", options["trees"], x=x, y=y, burns=x < 1)


near = service("neighbours", draws="ePicture", summary=True, radius=2.0)
world = World(forest, services=[near], options={"trees": 1000}, name="forest")
density = {"trees": [500, 750, 1000, 1250]}
table = sweep(world, density, frames=60, collect={"burnt": Tree.burnt.mean()}, quiet=True)
table.plot("burnt").save("sweep.png")
