"""An epidemic among people who move: a world, its runs and its curve in one file."""

import numpy as np

from minerva_bus import Agent, EventType, Primitive, World, count, on, run, service, view

SIZE = 20.0
PSpot = Primitive("PSpot", x=float, y=float, who=str, sick=float)
eWhere = EventType("eWhere", visual=True)
eNear = EventType("eNear", number=int, sick=float)  # the share of neighbours who are sick


class Person(Agent, symbol="APerson"):
    x: float
    y: float
    health: str = "S"  # susceptible, infected, recovered
    days: int = 0

    @on("eNear")
    def live(self, near, moment):
        if self.health == "I":
            self.days += 1
            self.health = "R" if self.days > 20 else "I"
        elif self.health == "S" and moment.chance.random() > 0.9 ** (near.sick * near.number):
            self.health = "I"
        self.x = (self.x + moment.chance.normal(0, 0.5)) % SIZE
        self.y = (self.y + moment.chance.normal(0, 0.5)) % SIZE

    @view("eWhere")
    def where(self, event):
        return PSpot(self.x, self.y, self.id, float(self.health == "I"))


place = np.random.default_rng(1).uniform(0, SIZE, (2, 200))
health = np.where(np.arange(200) < 3, "I", "S").astype(object)
people = Person.many("p", 200, x=place[0], y=place[1], health=health)
near = service("neighbours", summary=True, radius=1.0, periodic=True, width=SIZE, height=SIZE)
world = World(people, services=[near], name="sir")

if __name__ == "__main__":
    sick = {letter: count(Person, f"health == '{letter}'") for letter in "SIR"}
    done = run(world, frames=300, seed=7, collect=sick)
    print(done.table())
