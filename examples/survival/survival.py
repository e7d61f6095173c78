"""Rabbits that smell grass with two nostrils, and starve unless they find it (docs/howto/rl.md)."""

import math
from typing import Annotated

from minerva_bus import (
    EMPTY,
    Agent,
    Degrees,
    Disc,
    EventType,
    Metres,
    Motion,
    Primitive,
    Range,
    Transformation,
    World,
    each,
    on,
    portable,
    view,
)

SIZE, SPEED, HUNGER, NOSE = 20.0, 0.25, 0.03, 0.6

PRabbit = Primitive("PRabbit", Disc("radius", "#7d6b5d", heading=True), radius=Metres)
TPlace = Transformation("TPlace", Motion("x", "y", "angle"), x=Metres, y=Metres, angle=Degrees)
eStep = EventType("eStep")
eSteer = EventType("eSteer", turn=Annotated[Degrees, Range(-30, 30)])
ePicture = EventType("ePicture", visual=True)


def scent(x, y, frame):
    """Scent of the grass, from 0 to 1: strongest at a place that moves in a circle."""
    turn = 2 * math.pi * frame / 400
    far = portable.hypot(x - 10 - 6 * portable.cos(turn), y - 10 - 6 * portable.sin(turn))
    return 1 / (1 + (far / 3) ** 2)


class Rabbit(Agent, symbol="ARabbit"):
    """Walks on, and eats what grows there."""

    x: Metres
    y: Metres
    heading: Degrees = 0.0
    energy: float = 2.0
    left: float = 0.0
    right: float = 0.0

    @on("eSteer")
    def steer(self, steer, moment):
        self.heading += steer.turn

    @on("eStep")
    def walk(self, step, moment):
        x, y = self.ahead(SPEED, 0)
        self.x, self.y = min(max(x, 0.0), SIZE), min(max(y, 0.0), SIZE)
        self.energy = min(4.0, self.energy + 0.1 * scent(self.x, self.y, moment.number) - HUNGER)
        if self.energy <= 0:
            return EMPTY
        noise = 1 + 0.1 * moment.random.normal()
        self.left = noise * scent(*self.ahead(NOSE, 60), moment.number)
        self.right = noise * scent(*self.ahead(NOSE, -60), moment.number)
        return None

    def ahead(self, way, angle):
        """The place `way` metres from here, in a direction `angle` degrees left of the heading."""
        turn = math.radians(self.heading + angle)
        return self.x + way * portable.cos(turn), self.y + way * portable.sin(turn)

    @view("ePicture")
    def picture(self, event):
        return TPlace(self.x, self.y, self.heading)(PRabbit(0.3))


def rabbits(options):
    """Rabbits at places of a spiral, in all directions."""
    count = options["rabbits"]
    places = [(math.sqrt((n + 0.5) / count), 2.4 * n) for n in range(count)]
    made = [
        Rabbit(
            f"r{n}",
            x=10 + 9 * radius * portable.cos(turn),
            y=10 + 9 * radius * portable.sin(turn),
            heading=97.0 * n % 360,
        ).string
        for n, (radius, turn) in enumerate(places)
    ]
    return sum(made, EMPTY)


world = World(
    rabbits,
    agents=[Rabbit],
    services=[each(eStep)],
    symbols=[eSteer, PRabbit, TPlace, ePicture],
    options={"rabbits": 24},
    order=[eSteer, eStep],
    name="survival",
)
