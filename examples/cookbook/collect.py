"""Collect and plot: an epidemic among 400 people, and its curves."""

import numpy as np

from minerva_bus import Disc, EventType, World, count, on, run, service
from minerva_study import Placed

eNear = EventType("eNear", sum_sick=float)  # the number of sick neighbours


class Person(Placed, form=Disc(0.2, "groups(state, 0, 3)", meaning="healthy, sick, immune")):
    sick: bool = False
    days: int = 0
    state: int = 0

    @on("eNear", population=True)
    def live(self, near, moment):
        caught = moment.chance.random() > 0.9**near.sum_sick
        self.days += self.sick
        self.sick = (self.sick | caught) & (self.days <= 20)
        self.state = np.where(self.days > 20, 2, self.sick)
        self.x += moment.chance.normal(0, 0.3)
        self.y += moment.chance.normal(0, 0.3)


x, y = np.random.default_rng(1).uniform(0, 20, (2, 400))
people = Person.many("p", 400, x=x, y=y, sick=np.arange(400) < 4)
near = service("neighbours", draws="ePicture", summary=True)
curves = {"sick": count(Person, "sick == true"), "immune": count(Person, "days > 20")}
run(World(people, services=[near], name="sir"), frames=100, collect=curves).plot("collect.png")
