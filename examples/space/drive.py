"""Cars with four driven wheels that look for places on rough ground (extensions/learning/rl.md)."""

import math
from typing import Annotated

import numpy as np

from minerva_bodies import Box, Cylinder, Joint, Matter, Rigid, euler, quaternion
from minerva_bus import (
    Agent,
    Default,
    EventType,
    Metres,
    Primitive,
    Range,
    Transformation,
    World,
    each,
    on,
    service,
    view,
)

APART, TIME, FASTEST = 10.0, 60, 600.0
"""Metres between cars; frames for each place; degrees per second of a wheel."""
AXLES = {"fl": (0.35, 0.3), "fr": (0.35, -0.3), "bl": (-0.35, 0.3), "br": (-0.35, -0.3)}
UPRIGHT = {"w": 0.5**0.5, "i": -(0.5**0.5)}  # the axis of a wheel is its z axis

PLACE = dict.fromkeys("xyz", Default(Metres, 0.0)) | {"w": Default(float, 1.0)}
PLACE |= dict.fromkeys("ijk", Default(float, 0.0))
AXLE = {"axis": (0, 0, 1), "speed": "speed", "damping": 5}
Power = Annotated[float, Range(-1, 1)]

RUBBER = Matter(friction=1.0)

PGround = Primitive("PGround", Box(30, 200, 0.5, "#d8d4c7", matter=Matter(friction=0.9)))
PBump = Primitive("PBump", Box(0.4, 0.4, 0.06, "#9c9788", matter=Matter(friction=0.9)))
PBody = Primitive("PBody", Box(0.5, 0.2, 0.1, "#b5523b", matter=Matter(density=300)))
PWheel = Primitive("PWheel", Cylinder(0.06, 0.2, "#4a4f57", matter=RUBBER), who=str)
PAxle = Primitive(
    "PAxle", Joint("revolute", "car", "wheel", **AXLE), car=str, wheel=str, speed=float
)
TAt = Transformation("TAt", euler("x", "y", "z", turn="turn"), **dict.fromkeys("xyz", Metres),
                     turn=float)  # fmt: skip
TPose = Transformation("TPose", quaternion("x", "y", "z", "w", "i", "j", "k"), **PLACE)
eStep = EventType("eStep")
eDrive = EventType("eDrive", left=Power, right=Power)  # of the policy
ePose = EventType("ePose", **PLACE)
eBodies = EventType("eBodies", visual=True)


class Posed(Agent):
    """An agent whose pose physics sets, for all of its kind at once."""

    x: Metres
    y: Metres
    z: Metres = 0.25
    w: float = 1.0
    i: float = 0.0
    j: float = 0.0
    k: float = 0.0

    @on("ePose", population=True)
    def move(self, pose, moment):
        for name in PLACE:
            setattr(self, name, getattr(pose, name))

    def placed(self, scene):
        return TPose(self.x, self.y, self.z, self.w, self.i, self.j, self.k)(scene)


class Wheel(Posed, symbol="AWheel"):
    """A wheel, whose view is made for all wheels at once."""

    @view("eBodies", population=True)
    def picture(self, event):
        return self.placed(PWheel(self.id))


class Car(Posed, symbol="ACar"):
    """It knows the way to a place along its own axes; `gained` are the metres that it came near."""

    gx: Metres
    gy: Metres
    left: float = 0.0
    right: float = 0.0
    ahead: Metres = 0.0
    aside: Metres = 0.0
    apart: Metres = 0.0
    gained: Metres = 0.0

    @on("eDrive")
    def drive(self, drive, moment):
        self.left, self.right = drive.left, drive.right

    @on("eStep")
    def look(self, step, moment):
        pose = Rigid(self.x, self.y, self.z, self.w, self.i, self.j, self.k)
        self.gained += self.apart - math.hypot(self.gx - self.x, self.gy - self.y)
        if moment.number % TIME == 1:
            self.gx = self.x + moment.chance.uniform(-3.0, 3.0)
            self.gy = self.y + moment.chance.uniform(-3.0, 3.0)
        self.apart = math.hypot(self.gx - self.x, self.gy - self.y)
        self.ahead, self.aside, _ = pose.inverse().turned(self.gx - self.x, self.gy - self.y, 0.0)

    @view("eBodies")
    def picture(self, event):
        axles = [
            TPose(x, y, **UPRIGHT)(
                PAxle(self.id, f"{self.id}{name}", FASTEST * (self.left if y > 0 else self.right))
            )
            for name, (x, y) in AXLES.items()
        ]
        return self.placed(sum(axles, PBody()))


def cars(options):
    """Cars in a row, on ground with bumps."""
    random, count = np.random.default_rng(5), options["robots"]
    made = TAt(0.0, 0.0, -0.5, 0.0)(PGround())
    for x, y in random.uniform((-5.0, -5.0), (5.0, APART * count - 5.0), (4 * count, 2)):
        made += TAt(float(x), float(y), 0.0, float(random.uniform(0, 90)))(PBump())
    for number in range(count):
        y, name = APART * number, f"c{number}"
        made += Car(id=name, x=0.0, y=y, gx=0.0, gy=y).string
        for wheel, (dx, dy) in AXLES.items():
            made += Wheel(id=f"{name}{wheel}", x=dx, y=y + dy, **UPRIGHT).string
    return made


world = World(
    cars,
    agents=[Car, Wheel],
    services=[service("bodies", substeps=8), each(eStep)],
    symbols=[PGround, PBump, PBody, PWheel, PAxle, TAt, TPose, eStep, eDrive, ePose, eBodies],
    options={"robots": 16},
    order=[eDrive, ePose, eStep],
    dt=0.05,
    name="drive",
)
