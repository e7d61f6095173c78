"""Births and deaths: bacteria eat, divide and starve; a picture and the curve of their number."""

from minerva_bus import Disc, World, count, each, on, run
from minerva_study import Placed


class Germ(Placed, form=Disc(0.15, "viridis(energy, 0, 8)")):
    energy: float = 4.0
    births: int = 0  # Children get their ids from it.

    @on("eStep", population=True)
    def live(self, step, moment):
        self.x += moment.chance.normal(0, 0.2)
        self.y += moment.chance.normal(0, 0.2)
        self.energy += moment.chance.random() * 600 / (300 + len(self)) - 0.5
        self.die(self.energy < 0)
        divides = self.energy > 8
        self.energy /= 1 + divides
        self.bear(divides, x=self.x, y=self.y, energy=self.energy)


world = World(Germ.many("g", 20, x=0.0, y=0.0), services=[each("eStep")], name="germs")
done = run(world, frames=120, seed=1, collect={"germs": count(Germ)})
done.picture().save("births.svg")
done.plot("births-curve.png", "germs")
