"""Load from a table: each row is a house, and the water rises by a metre in each frame."""

from pathlib import Path

import numpy as np

from minerva_bus import Disc, World, each, on, run
from minerva_study import Placed

Path("houses.csv").write_text("x,y,height\n1,1,2\n4,3,9\n6,1.5,4\n8,4,7\n2,4,5\n5,5,12\n")


class House(Placed, form=Disc(0.4, "blues(water, 0, 8)")):
    height: float
    water: float = 0.0  # metres

    @on("eStep", population=True)
    def rise(self, step, moment):
        self.water = np.maximum(0, moment.frame.number + 1 - self.height)


table = np.genfromtxt("houses.csv", delimiter=",", names=True)  # or pandas, polars
columns = {name: table[name] for name in table.dtype.names}
houses = House.many("h", len(table), **columns)
done = run(World(houses, services=[each("eStep")], name="flood"), frames=8)
print(done.agents(House, "water > 0"))
done.picture().save("load.svg")
