"""Forest: a fire spreads among 20,000 trees: its picture, film and curve, and a sweep."""

import numpy as np

from minerva_bus import Disc, EventType, World, count, on, run, service
from minerva_study import Placed, sweep

TREES = 20_000
eNear = EventType("eNear", sum_burns=float)  # the number of burning trees nearby


class Tree(Placed, form=Disc(0.9, "#084 #d50 #444(state, 0, 3)", meaning="green, burns, burnt")):
    burns: bool
    state: int = 0

    @on("eNear", population=True)
    def burn(self, near, moment):
        self.burns = (self.state == 0) & (moment.chance.random() > 0.3**near.sum_burns)
        self.state = np.where(self.burns, 1, np.minimum(2 * self.state, 2))


def forest(options):
    wide = (options["area"] * TREES) ** 0.5
    x, y = np.random.default_rng(1).uniform(-wide / 2, wide / 2, (2, TREES))
    fire = x**2 + y**2 < 20
    return Tree.many("t", TREES, x=x, y=y, burns=fire, state=np.int64(fire))


near = service("neighbours", draws="ePicture", summary=True, radius=2.5)
world = World(forest, services=[near], options={"area": 3.0}, name="forest")  # m² for each tree
curve = {"burnt": count(Tree, "state == 2")}
done = run(world, frames=100, film=10, collect=curve)
done.film().save("forest.html")
done.picture().save("forest.svg")
done.plot("forest-curve.png")
table = sweep(world, {"area": [2.0, 2.5, 3.0, 3.5, 4.0]}, frames=200, collect=curve)
table.plot("burnt", x="area").save("forest-sweep.png")
