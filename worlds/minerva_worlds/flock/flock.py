"""A flock: birds that steer by events about their neighbours, and a hawk among them.

A bird has a state, steers by its neighbours, and shows its position and its picture. It steers as
one bird, which `compiled` in flock.toml runs as machine code with numba, and the figures of all are
made at once.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np

from minerva_bus import (
    Agent,
    Cells,
    Context,
    Default,
    Degrees,
    Disc,
    Event,
    EventType,
    Metres,
    Motion,
    Primitive,
    Range,
    Raster,
    Scene,
    Transformation,
    Vocabulary,
    on,
    portable,
    view,
)

WIDTH, HEIGHT, CELL = 60.0, 36.0, 2.0

# --- the vocabulary: what birds perceive, their pictures, the events ------------------------------

PSpot = Primitive("PSpot", who=str, vx=float, vy=float, fear=Default(float, 0.0))
PBird = Primitive("PBird", Disc("radius", "#37618e", heading=True), radius=Metres)
PHawk = Primitive("PHawk", Disc("radius", "#c2452d", heading=True), radius=Metres)
PSky = Primitive("PSky", Raster("cells", CELL, colors=((0, "#e8f0f4"),)), cells=Cells)
TMove = Transformation("TMove", Motion("x", "y"), x=Metres, y=Metres)
TTurn = Transformation("TTurn", Motion(turn="angle"), angle=Degrees)

eWhere = EventType("eWhere", visual=True)
ePicture = EventType("ePicture", visual=True)
eNear = EventType(
    "eNear",
    number=int,
    dx=Metres,
    dy=Metres,
    vx=float,
    vy=float,
    fear=float,
    apart_x=Metres,
    apart_y=Metres,
)
eTurn = EventType("eTurn", angle=Annotated[Degrees, Range(-30, 30)])  # of people and policies

# --- the agents -----------------------------------------------------------------------------------


class Bird(Agent, symbol="ABird"):
    """Flies with the others without colliding, and away from the hawk."""

    x: Metres
    y: Metres
    vx: float
    vy: float

    @on("eNear")
    def steer(self, near: Event, moment: Context) -> None:
        flee = -0.3 if near.fear > 0 else 0.012  # away from the neighbours, or towards them
        vx = self.vx + flee * near.dx + 0.03 * near.apart_x + 0.12 * near.vx
        vy = self.vy + flee * near.dy + 0.03 * near.apart_y + 0.12 * near.vy
        speed = max(portable.hypot(vx, vy), 0.01)
        self.vx, self.vy = vx / speed, vy / speed
        self.x = (self.x + 0.25 * self.vx) % WIDTH
        self.y = (self.y + 0.25 * self.vy) % HEIGHT

    @on("eTurn")
    def turn(self, turn: Event, moment: Context) -> None:
        angle = math.radians(turn.angle)
        cos, sin, vx, vy = portable.cos(angle), portable.sin(angle), self.vx, self.vy
        self.vx, self.vy = cos * vx - sin * vy, sin * vx + cos * vy

    @view("eWhere", population=True)
    def where(self, event: Event) -> Scene:
        return TMove(self.x, self.y)(PSpot(self.id, self.vx, self.vy))

    @view("ePicture", population=True)
    def picture(self, event: Event) -> Scene:
        angle = np.degrees(portable.atan2(self.vy, self.vx))
        return TMove(self.x, self.y)(TTurn(angle)(PBird(0.3)))


class Hawk(Agent, symbol="AHawk"):
    """Flies to the centre of nearby birds; a single agent, so its attributes are plain numbers."""

    x: Metres
    y: Metres
    angle: Degrees = 0.0

    @on("eNear")
    def hunt(self, near: Event, moment: Context) -> None:
        prey = math.degrees(portable.atan2(near.dy, near.dx)) if near.number else self.angle
        turn = (prey - self.angle + 180.0) % 360.0 - 180.0
        self.angle += max(-4.0, min(4.0, turn))
        self.x = (self.x + 0.3 * portable.cos(math.radians(self.angle))) % WIDTH
        self.y = (self.y + 0.3 * portable.sin(math.radians(self.angle))) % HEIGHT

    @view("eWhere")
    def where(self, event: Event) -> Scene:
        return TMove(self.x, self.y)(PSpot(self.id, 0.0, 0.0, fear=1.0))

    @view("ePicture")
    def picture(self, event: Event) -> Scene:
        return TMove(self.x, self.y)(TTurn(self.angle)(PHawk(0.6)))


# --- the world ------------------------------------------------------------------------------------

vocabulary = Vocabulary.of(
    *(PSpot, PBird, PHawk, PSky, TMove, TTurn, eWhere, ePicture, eNear, eTurn, Bird, Hawk)
)


def scene(options: Mapping[str, Any]) -> Scene:
    """The sky, birds at random positions, and a hawk in the middle."""
    chance, count = np.random.default_rng(1), options["birds"]
    x, y = chance.uniform(0, WIDTH, count), chance.uniform(0, HEIGHT, count)
    turn = chance.uniform(0, 2 * np.pi, count)
    birds = Bird.many("b", count, x=x, y=y, vx=portable.cos(turn), vy=portable.sin(turn))
    sky = PSky(np.zeros((int(WIDTH / CELL), int(HEIGHT / CELL)), np.int16))
    return sky + birds + vocabulary.read(f"AHawk#hawk<x={WIDTH / 2}, y={HEIGHT / 2}>")
