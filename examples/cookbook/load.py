"""Load from a table: each row is a house, and the water rises by a metre in each frame."""

from pathlib import Path

import numpy as np

from minerva_bus import Disc, World, each, on, run
from minerva_study import Placed

Path("houses.csv").write_text("x,y,height\n1,1,2\n4,3,9\n6,1.5,4\n8,4,7\n2,4,5\n5,5,12\n")


class House(Placed, form=Disc(0.4, "blues(under, 0, 8)")):
    height: float
    under: float = 0.0  # metres of water

    @on("eStep", population=True)
    def rise(self, step, moment):
        self.under = np.maximum(0, moment.frame.number + 1 - self.height)


table = np.genfromtxt("houses.csv", delimiter=",", names=True)  # or pandas, polars
columns = {name: table[name] for name in table.dtype.names}
houses = House.many("h", len(table), **columns)
done = run(World(houses, services=[each("eStep")], name="flood"), frames=8)
print(done.agents(House, "under > 0"))
done.picture().save("load.svg")
