"""An epidemic among 200 people who move: a world, a run and its curves."""

import numpy as np

from minerva_bus import Agent, EventType, Primitive, World, count, on, run, service, view

PSpot = Primitive("PSpot", x=float, y=float, who=str, sick=bool)
eWhere = EventType("eWhere", visual=True)
eNear = EventType("eNear", number=int, sick=float)  # of neighbours; sick: their share


class Person(Agent, symbol="APerson"):
    x: float
    y: float
    sick: bool = False
    days: int = 0

    @on("eNear", population=True)  # self.x is an array with a number for each person
    def live(self, near, moment):
        caught = moment.chance.random() > 0.9 ** (near.sick * near.number)
        self.days += self.sick
        self.sick = (self.sick | caught) & (self.days <= 20)  # After 20 days one is immune.
        self.x = (self.x + moment.chance.normal(0, 0.5)) % 20
        self.y = (self.y + moment.chance.normal(0, 0.5)) % 20

    @view("eWhere", population=True)
    def where(self, event):
        return PSpot(self.x, self.y, self.id, self.sick)


x, y = np.random.default_rng(1).uniform(0, 20, (2, 200))
people = Person.many("p", 200, x=x, y=y, sick=np.arange(200) < 3)
near = service("neighbours", summary=True, radius=1.0, periodic=True, width=20.0, height=20.0)
world = World(people, services=[near], name="sir")
curves = {"sick": count(Person, "sick == true"), "immune": count(Person, "days > 20")}

if __name__ == "__main__":
    print(run(world, frames=300, seed=7, collect=curves).table())
