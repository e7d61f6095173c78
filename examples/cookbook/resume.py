"""Resume: a recorded run of 50 frames continues to frame 100, as if it had not ended."""

from minerva_bus import Disc, World, each, on, record, resume, run
from minerva_study import Placed


class Walker(Placed, form=Disc(0.3, "viridis(way, 0, 60)")):
    way: float = 0.0

    @on("eStep", population=True)
    def walk(self, step, moment):
        self.way += moment.chance.random()
        self.x += moment.chance.normal(0, 0.5)
        self.y += moment.chance.normal(0, 0.5)


world = World(Walker.many("w", 20, x=0.0, y=0.0), services=[each("eStep")], name="walk")
record(world, "walk.mcap", frames=50, seed=1)
done = resume("walk.mcap", world, frames=100)
assert done.digest == run(world, frames=100, seed=1).digest
done.picture().save("resume.svg")
