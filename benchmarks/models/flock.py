"""Boids (Reynolds 1987) as in Mesa's example: cohesion, separation and alignment.

A step takes two frames: in the first the service determines the positions, in the second all boids
steer and move. All boids therefore act simultaneously on the state before the step; in Mesa they
act one after another, in a new random order for each step.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np

from minerva_bus import (
    Agent,
    BatchContext,
    Context,
    Event,
    EventType,
    Primitive,
    Scene,
    Transformation,
    Vocabulary,
    on,
    view,
)
from minerva_bus.world.services import Service
from minerva_services.physics.neighbours import Neighbours

NAME = "flock"
CYCLE = 2
order = ("eNear",)

SPEED = 1.0
VISION = 10.0
SEPARATION = 2.0
COHERE, SEPARATE, MATCH = 0.03, 0.015, 0.05
AREA = 100.0
"""Area of the plane per boid."""

# Variables have the names of their symbols in the string.
PSpot = Primitive("PSpot", who=str, vx=float, vy=float)
TMove = Transformation("TMove", x=float, y=float)
eWhere = EventType("eWhere", visual=True)
eNear = EventType(
    "eNear", number=int, dx=float, dy=float, vx=float, vy=float, apart_x=float, apart_y=float
)


class Boid(Agent, symbol="ABoid"):
    """Moves on a plane whose opposite edges are connected."""

    x: float
    y: float
    vx: float
    vy: float

    @on("eNear", population=True)
    def steer(self, near: Event, moment: BatchContext) -> None:
        several = np.maximum(near.number, 1)
        vx = self.vx + (COHERE * near.dx + SEPARATE * near.apart_x / several + MATCH * near.vx)
        vy = self.vy + (COHERE * near.dy + SEPARATE * near.apart_y / several + MATCH * near.vy)
        length = np.where(near.number > 0, np.sqrt(vx * vx + vy * vy), 1.0)
        self.vx, self.vy = vx / length, vy / length
        self.x += SPEED * self.vx
        self.y += SPEED * self.vy

    @view("eWhere", population=True)
    def where(self, event: Event) -> Scene:
        return TMove(self.x, self.y)(PSpot(self.id, self.vx, self.vy))


class PlainBoid(Agent, symbol="ABoid"):
    """The same as Boid, with activities for a single agent."""

    x: float
    y: float
    vx: float
    vy: float

    @on("eNear")
    def steer(self, near: Event, moment: Context) -> None:
        if near.number:
            n = near.number
            self.vx += COHERE * near.dx + SEPARATE * near.apart_x / n + MATCH * near.vx
            self.vy += COHERE * near.dy + SEPARATE * near.apart_y / n + MATCH * near.vy
            length = math.sqrt(self.vx * self.vx + self.vy * self.vy)
            self.vx /= length
            self.vy /= length
        self.x += SPEED * self.vx
        self.y += SPEED * self.vy

    @view("eWhere")
    def where(self, event: Event) -> Scene:
        return TMove(self.x, self.y)(PSpot(self.id, self.vx, self.vy))


kinds: list[type[Agent]] = [Boid]
plain_kinds: list[type[Agent]] = [PlainBoid]
vocabulary = Vocabulary.of(PSpot, TMove, eWhere, eNear, Boid)


def side(agents: int) -> float:
    """Side of the square for this number of boids."""
    return math.sqrt(agents * AREA)


def scene(agents: int, seed: int) -> Scene:
    """Boids with random positions and directions."""
    chance = np.random.default_rng(seed)
    x, y = chance.uniform(0.0, side(agents), (2, agents))
    vx, vy = chance.uniform(-1.0, 1.0, (2, agents))
    return Boid.many("b", agents, x=x, y=y, vx=vx, vy=vy)


def services(agents: int) -> dict[str, Callable[[], Service]]:
    """The service that sends boids a summary of their neighbours."""
    return {
        "neighbours": partial(
            Neighbours,
            every=CYCLE,
            radius=VISION,
            apart=SEPARATION,
            width=side(agents),
            height=side(agents),
            periodic=True,
            summary=True,
        )
    }


def updates_per_frame(agents: int) -> int:
    """All boids act in every second frame."""
    return agents // CYCLE
