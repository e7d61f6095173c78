"""Events by chance: lightning strikes at random places, and the trees near it burn."""

import numpy as np

from minerva_bus import Disc, EventType, Generator, World, on, run
from minerva_study import Placed

eStrike = EventType("eStrike", x=float, y=float)


class Tree(Placed, form=Disc(0.3, "#009e73 #d55e00(burnt, 0, 2)", meaning="green, burnt")):
    burnt: bool = False

    @on("eStrike", population=True)
    def burn(self, strike, moment):
        self.burnt |= (self.x - strike.x) ** 2 + (self.y - strike.y) ** 2 < 4


class Storm(Generator, events=("eStrike",)):
    def generate(self, tick):
        if tick.random.random() < 0.2:
            yield eStrike(*tick.random.uniform(0, 20, 2).tolist())


x, y = np.random.default_rng(1).uniform(0, 20, (2, 400))
world = World(Tree.many("t", 400, x=x, y=y), services=[Storm], name="storm")
done = run(world, frames=60, seed=3)
print(done.events)
done.picture().save("chance.svg")
