"""Rubble: thousands of solids fall into a yard, and people push them.

A piece has a pose, which events of physics set, and an impulse for one frame, which a push sets.
Its view is its solid within both: physics reads the impulse, and a picture the pose.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast

import numpy as np

from minerva_bodies import Ball as BallForm
from minerva_bodies import Box, Command, Cylinder, Matter, euler, quaternion
from minerva_bus import (
    Agent,
    BatchContext,
    Context,
    Event,
    EventType,
    Metres,
    Primitive,
    Scene,
    Transformation,
    Vocabulary,
    on,
    portable,
    view,
)

HALF = 8.0  # of the yard, metres
DT = 0.02

# --- the vocabulary -------------------------------------------------------------------------------

BRICK = Matter(density=1800, friction=0.7)
WOOD = Matter(density=600, friction=0.4, restitution=0.3)
GROUND = Matter(friction=0.8, fixed=True)
STEEL = Matter(kinematic=True, friction=0.2)

PBrick = Primitive("PBrick", Box(0.24, 0.12, 0.08, "#b5523b", matter=BRICK), who=str)
PBall = Primitive("PBall", BallForm(0.15, "#3b7ea1", matter=WOOD), who=str)
PDrum = Primitive("PDrum", Cylinder(0.16, 0.14, "#d9a441", matter=WOOD), who=str)
PYard = Primitive("PYard", Box(HALF, HALF, 0.5, "#d8d4c7", matter=GROUND))
PWallX = Primitive("PWallX", Box(HALF, 0.2, 0.6, "#9c9788", matter=GROUND, meaning="wall"))
PWallY = Primitive("PWallY", Box(0.2, HALF, 0.6, "#9c9788", matter=GROUND, meaning="wall"))
PBlade = Primitive("PBlade", Box(0.15, 2.0, 0.4, "#4a4f57", matter=STEEL, meaning="plough"))

PLACE: dict[str, Any] = {**dict.fromkeys("xyz", Metres), **dict.fromkeys("wijk", float)}

TAt = Transformation("TAt", euler("x", "y", "z"), x=Metres, y=Metres, z=Metres)
TPose = Transformation("TPose", quaternion("x", "y", "z", "w", "i", "j", "k"), **PLACE)
TImpulse = Transformation("TImpulse", Command("impulse", "x", "y", "z"), x=float, y=float, z=float)

eStep = EventType("eStep")
ePose = EventType("ePose", **PLACE)
ePush = EventType("ePush", x=Metres, y=Metres, reach=Metres, speed=float)
# For physics in each frame, and for people as often as they look.
eBodies = EventType("eBodies", visual=True)
ePicture = EventType("ePicture", visual=True)

# --- the agents -----------------------------------------------------------------------------------


class Piece(Agent):
    """Common state and behaviour of bricks, balls and drums; methods take all of them at once."""

    mass: float
    x: Metres
    y: Metres
    z: Metres
    w: float = 1.0
    i: float = 0.0
    j: float = 0.0
    k: float = 0.0
    px: float = 0.0
    py: float = 0.0
    pz: float = 0.0

    @on("eStep", population=True)
    def rest(self, step: Event, moment: BatchContext) -> None:
        self.px = self.py = self.pz = 0.0

    @on("ePose", population=True)
    def place(self, pose: Event, moment: BatchContext) -> None:
        self.x, self.y, self.z = pose.x, pose.y, pose.z
        self.w, self.i, self.j, self.k = pose.w, pose.i, pose.j, pose.k

    @on("ePush", population=True)
    def push(self, push: Event, moment: BatchContext) -> None:
        """Away from a point, and up; `speed` (m/s) at the point, none at `reach`."""
        dx: Any = self.x - push.x
        dy: Any = self.y - push.y
        distance = np.maximum(cast("Any", portable.hypot(dx, dy)), 0.01)
        impulse = self.mass * push.speed * np.maximum(0.0, 1.0 - distance / push.reach)
        self.px, self.py = impulse * dx / distance, impulse * dy / distance
        self.pz = impulse

    def shown(self, solid: Primitive) -> Scene:
        pose = TPose(self.x, self.y, self.z, self.w, self.i, self.j, self.k)
        return pose(TImpulse(self.px, self.py, self.pz)(solid(self.id)))


class Brick(Piece, symbol="ABrick"):
    @view("eBodies", "ePicture", population=True)
    def picture(self, event: Event) -> Scene:
        return self.shown(PBrick)


class Ball(Piece, symbol="ABall"):
    @view("eBodies", "ePicture", population=True)
    def picture(self, event: Event) -> Scene:
        return self.shown(PBall)


class Drum(Piece, symbol="ADrum"):
    @view("eBodies", "ePicture", population=True)
    def picture(self, event: Event) -> Scene:
        return self.shown(PDrum)


class Plough(Agent, symbol="APlough"):
    """A blade that goes to and fro; physics moves it with the string, and nothing stops it."""

    x: Metres = -6.0
    speed: float = 0.5

    @on("eStep")
    def go(self, step: Event, moment: Context) -> None:
        if abs(self.x + self.speed * DT) > 6.0:
            self.speed = -self.speed
        self.x += self.speed * DT

    @view("eBodies", "ePicture")
    def picture(self, event: Event) -> Scene:
        return TAt(self.x, 0.0, 0.4)(PBlade())


# --- the world ------------------------------------------------------------------------------------

vocabulary = Vocabulary.of(
    *(PBrick, PBall, PDrum, PYard, PWallX, PWallY, PBlade, TAt, TPose, TImpulse),
    *(eStep, ePose, ePush, eBodies, ePicture, Brick, Ball, Drum, Plough),
)

YARD = (
    TAt(0.0, 0.0, -0.5)(PYard())
    + TAt(0.0, HALF, 0.3)(PWallX())
    + TAt(0.0, -HALF, 0.3)(PWallX())
    + TAt(HALF, 0.0, 0.3)(PWallY())
    + TAt(-HALF, 0.0, 0.3)(PWallY())
)


def scene(options: Mapping[str, Any]) -> Scene:
    """The yard, the plough, and pieces in layers above the ground."""
    chance, count = np.random.default_rng(3), int(options["pieces"])
    number = np.arange(count)
    x = 0.6 * (number % 10 - 4.5) + chance.uniform(-0.1, 0.1, count)
    y = 0.6 * (number // 10 % 10 - 4.5) + chance.uniform(-0.1, 0.1, count)
    z = 1.0 + 0.5 * (number // 100)
    turn = chance.uniform(0.0, np.pi, count)
    pose = {"x": x, "y": y, "z": z, "w": portable.cos(turn), "k": portable.sin(turn)}
    kinds = [(Brick, "brick", 16.6), (Ball, "ball", 8.5), (Drum, "drum", 11.8)]
    made = YARD
    for at, (kind, name, mass) in enumerate(kinds[:count]):
        rows = {attribute: values[at::3] for attribute, values in pose.items()}
        made += kind.many(name, len(rows["x"]), mass=mass, **rows)
    return made + vocabulary.read("APlough#plough")
