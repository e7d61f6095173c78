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
        self.burns = (moment.chance.random() > 0.5**near.sum_burns) & ~self.burnt


def forest(options):
    x, y = np.random.default_rng(1).uniform(0, 50, (2, options["trees"]))
    return Tree.many("t", options["trees"], x=x, y=y, burns=x < 1)


near = service("neighbours", draws="ePicture", summary=True, radius=2.0)
world = World(forest, services=[near], options={"trees": 1000}, name="forest")
density = {"trees": [500, 750, 1000, 1250, 1500, 1750]}
burnt = {"burnt": Tree.burnt.mean()}
table = sweep(world, density, seeds=4, frames=200, collect=burnt, quiet=True)
table.plot("burnt", x="trees").save("sweep.png")  # in the last frame, when the fires are out
