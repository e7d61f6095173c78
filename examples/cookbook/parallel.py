"""Many runs in parallel: 20 random walks, on all cores, and the band of their places."""

from minerva_bus import World, each, on
from minerva_study import Placed, sweep


class Walker(Placed):
    @on("eStep", population=True)
    def walk(self, step, moment):
        self.x += moment.chance.normal(0.1, 1.0)


world = World(Walker("w", x=0.0, y=0.0).string, services=[each("eStep")], name="walk")
table = sweep(world, seeds=20, frames=60, collect={"place": Walker.x.mean()}, quiet=True)
print(table)
table.plot("place").save("parallel.png")
