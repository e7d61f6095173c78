"""Rabbits that smell grass, and starve unless they find it (extensions/learning/rl.md)."""

import math
from typing import Annotated

import numpy as np

from minerva_bus import (
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

    @on("eSteer", population=True)
    def steer(self, steer, moment):
        self.heading += steer.turn

    @on("eStep", population=True)
    def walk(self, step, moment):
        x, y = ahead(self, SPEED, 0)
        self.x, self.y = np.clip(x, 0.0, SIZE), np.clip(y, 0.0, SIZE)
        eaten = 0.1 * scent(self.x, self.y, moment.number)
        self.energy = np.minimum(4.0, self.energy + eaten - HUNGER)
        self.die(self.energy <= 0)
        noise = 1 + 0.1 * moment.chance.normal()
        self.left = noise * scent(*ahead(self, NOSE, 60), moment.number)
        self.right = noise * scent(*ahead(self, NOSE, -60), moment.number)

    @view("ePicture", population=True)
    def picture(self, event):
        return TPlace(self.x, self.y, self.heading)(PRabbit(0.3))


def ahead(rabbit, way, angle):
    """The place `way` metres from a rabbit, `angle` degrees left of its heading."""
    turn = (rabbit.heading + angle) * (math.pi / 180)
    return rabbit.x + way * portable.cos(turn), rabbit.y + way * portable.sin(turn)


def rabbits(options):
    """Rabbits at places of a spiral, in all directions."""
    count = options["rabbits"]
    places = [(math.sqrt((n + 0.5) / count), 2.4 * n) for n in range(count)]
    return Rabbit.many(
        "r",
        count,
        x=np.array([10 + 9 * radius * portable.cos(turn) for radius, turn in places]),
        y=np.array([10 + 9 * radius * portable.sin(turn) for radius, turn in places]),
        heading=np.array([97.0 * n % 360 for n in range(count)]),
    )


world = World(
    rabbits,
    agents=[Rabbit],
    services=[each(eStep)],
    symbols=[eSteer, PRabbit, TPlace, ePicture],
    options={"rabbits": 24},
    order=[eSteer, eStep],
    name="survival",
)
