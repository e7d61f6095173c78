"""Film: a drop of ink spreads in water; the page ink.html plays it in any browser."""

from minerva_bus import Disc, World, each, on, run
from minerva_study import Placed


class Ink(Placed, form=Disc(0.15, "#332288")):
    @on("eStep", population=True)
    def spread(self, step, moment):
        self.x += moment.chance.normal(0, 0.3)
        self.y += moment.chance.normal(0, 0.3)


world = World(Ink.many("i", 500, x=0.0, y=0.0), services=[each("eStep")], name="ink")
done = run(world, frames=60, seed=1, film=3)  # a picture of every third frame
done.film().save("ink.html")
done.picture().save("film.svg")
