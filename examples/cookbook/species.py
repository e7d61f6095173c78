"""Two species: rabbits multiply, and foxes eat those that they meet."""

import numpy as np

from minerva_bus import Disc, EventType, World, on, run, service
from minerva_study import Placed

eNear = EventType("eNear", number=int, sum_fox=float)  # neighbours, and foxes among them


class Animal(Placed, form=Disc(0.2, "groups(fox, 0, 2)", meaning="rabbit, fox")):
    fox: bool
    food: float = 4.0
    births: int = 0

    @on("eNear", population=True)
    def live(self, near, moment):
        rabbits = near.number - near.sum_fox
        self.food += np.where(self.fox, 0.3 * np.minimum(rabbits, 3) - 0.35, 0.4 - 0.06 * rabbits)
        self.die(self.food < 0)
        self.die(~self.fox & (moment.chance.random() > 0.9**near.sum_fox))
        self.x = np.clip(self.x + moment.chance.normal(0, 0.4), 0, 25)
        self.y = np.clip(self.y + moment.chance.normal(0, 0.4), 0, 25)
        self.bear(self.food > 8, x=self.x, y=self.y, fox=self.fox)
        self.food = np.where(self.food > 8, 4, self.food)


x, y = np.random.default_rng(1).uniform(0, 25, (2, 240))
animals = Animal.many("a", 240, x=x, y=y, fox=np.arange(240) % 12 == 0)
near = service("neighbours", draws="ePicture", summary=True)
run(World(animals, services=[near], name="meadow"), frames=200).picture().save("species.svg")
