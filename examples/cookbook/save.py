"""Save to a table: each walker in every tenth frame, and the fast ones of the last, as CSV."""

from minerva_bus import Disc, World, data, each, on, run
from minerva_study import Placed


class Walker(Placed, form=Disc(0.2, "viridis(way, 0, 30)")):
    way: float = 0.0

    @on("eStep", population=True)
    def walk(self, step, moment):
        length = moment.chance.random()
        self.x += length
        self.y += moment.chance.normal(0, 0.5)
        self.way += length


world = World(Walker.many("w", 50, x=0.0, y=0.0), services=[each("eStep")], name="walkers")
run(world, frames=50, seed=1, collect=[data(Walker).every(10)], into="walkers.csv")
done = run(world, frames=50, seed=1)
done.agents(Walker, "way > 25").to_csv("fast.csv")
done.picture().save("save.svg")
