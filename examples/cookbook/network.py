"""Network: a rumour passes along friendships, which are a ring with a few shortcuts."""

import numpy as np

from minerva_bus import EMPTY, Disc, EventType, Line, Primitive, World, each, on, run
from minerva_study import Placed

PLink = Primitive("PLink", Line("xs", "ys"), xs=tuple[float, ...], ys=tuple[float, ...])
eTell = EventType("eTell")


class Person(Placed, form=Disc(0.3, "groups(knows, 0, 2)", meaning="knows nothing, knows it")):
    friends: str  # their ids
    knows: bool = False

    @on("eTell")
    def hear(self, tell, moment):
        self.knows |= moment.chance.chance(0.3)

    @on("eStep")
    def tell(self, step, moment):
        if self.knows:
            moment.emit(eTell(receivers=self.friends.split()))


links = [(n, (n + 1) % 60) for n in range(60)] + [(3, 33), (11, 50), (20, 42), (27, 57)]
x, y = 8 * np.cos(np.arange(60) * np.pi / 30), 8 * np.sin(np.arange(60) * np.pi / 30)
scene = sum((PLink((x[a], x[b]), (y[a], y[b])) for a, b in links), EMPTY)
for n in range(60):
    friends = " ".join(f"p{a + b - n}" for a, b in links if n in (a, b))
    scene += Person(f"p{n}", x=x[n], y=y[n], friends=friends, knows=n < 1).string
world = World(scene, services=[each("eStep")], name="rumour")
run(world, frames=20).picture().save("network.svg")
