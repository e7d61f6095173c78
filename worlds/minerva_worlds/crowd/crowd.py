"""A crowd leaves a building: people only react to signs, neighbours and collisions.

A person has a state, follows the signs, gives way to neighbours, is pushed back by collisions, and
has an extent and an appearance. Only the signs have a map.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from minerva_bus import (
    Agent,
    BatchContext,
    Cells,
    Context,
    Default,
    Degrees,
    Device,
    Disc,
    Event,
    Events,
    EventType,
    Generator,
    Geometry,
    Ids,
    Label,
    Metres,
    MetresPerSecond,
    MinervaError,
    Motion,
    Primitive,
    Raster,
    Scene,
    Seconds,
    Tick,
    Transformation,
    View,
    Vocabulary,
    WorldInfo,
    interpret,
    on,
    portable,
    view,
)
from minerva_services.geometry.volumes import Bodies

CELL, RADIUS, EVERY = 0.5, 0.22, 2
FREE, WALL, EXIT = " ", "#", "E"

# --- the vocabulary -------------------------------------------------------------------------------

PWalls = Primitive(
    "PWalls",
    Raster(
        "cells",
        CELL,
        colors=((0, "#f3f0e8"), (1, "#9aa1ab")),
        height=1.2,
        meanings=("floor", "wall or pillar"),
    ),
    cells=Cells,
)
PExit = Primitive(
    "PExit", Raster("cells", CELL, colors=((0, ""), (1, "#4f9e63")), height=0.1), cells=Cells
)
PBody = Primitive("PBody", Disc("radius"), radius=Metres, who=str)
PWalker = Primitive("PWalker", Disc(RADIUS, "#37618e", heading=True, height=0.9, meaning="person"))
PStuck = Primitive(
    "PStuck", Disc(RADIUS, "#d4622a", heading=True, height=0.9, meaning="person without progress")
)
PCount = Primitive("PCount", Label("text", meaning="people outside and inside"), text=str)
TPlace = Transformation(
    "TPlace", Motion("x", "y", "angle"), x=Metres, y=Metres, angle=Default(Degrees, 0.0)
)

eBody = EventType("eBody", visual=True)
ePicture = EventType("ePicture", visual=True)
eSign = EventType("eSign", dx=float, dy=float)
eNear = EventType("eNear", number=int, apart_x=Metres, apart_y=Metres)
eCollision = EventType("eCollision", other=str, what=str, nx=float, ny=float, depth=Metres)
eOut = EventType("eOut")
eEmpty = EventType("eEmpty", seconds=Seconds)

# --- the agents -----------------------------------------------------------------------------------


class Person(Agent, symbol="APerson"):
    """Follows the signs, keeps its distance if possible, and never overlaps with others."""

    x: Metres
    y: Metres
    vx: MetresPerSecond = 0.0
    vy: MetresPerSecond = 0.0
    pace: MetresPerSecond = 1.3

    @on("eCollision", population=True)
    def bump(self, hit: Event, moment: BatchContext) -> None:
        out = hit.what == "PExit"
        moment.emit(eOut(), where=out)
        self.die(out)
        share = np.where(hit.other == "", 1.0, 0.5)  # of two people, each backs up half the way
        self.x = self.x + share * hit.depth * hit.nx
        self.y = self.y + share * hit.depth * hit.ny
        into = np.minimum(self.vx * hit.nx + self.vy * hit.ny, 0.0)
        self.vx = self.vx - into * hit.nx
        self.vy = self.vy - into * hit.ny

    @on("eNear", population=True)
    def give_way(self, near: Event, moment: BatchContext) -> None:
        self.vx = self.vx + 0.15 * near.apart_x
        self.vy = self.vy + 0.15 * near.apart_y

    @on("eSign", population=True)
    def walk(self, sign: Event, moment: BatchContext) -> None:
        self.vx = self.vx + 0.3 * (self.pace * sign.dx - self.vx)
        self.vy = self.vy + 0.3 * (self.pace * sign.dy - self.vy)
        self.x = self.x + self.vx * moment.dt * EVERY
        self.y = self.y + self.vy * moment.dt * EVERY

    @view("eBody", population=True)
    def body(self, event: Event) -> Scene:
        return TPlace(self.x, self.y)(PBody(RADIUS, self.id))

    @view("ePicture")
    def picture(self, event: Event) -> Scene:
        stuck = portable.hypot(self.vx, self.vy) < self.pace / 3
        angle = math.degrees(portable.atan2(self.vy, self.vx))
        return TPlace(self.x, self.y, angle)(PStuck() if stuck else PWalker())


class Building(Agent, symbol="ABuilding"):
    """Counts the people who have left, and reports when all have."""

    inside: int
    out: int = 0

    @on("eOut")
    def count(self, out: Event, moment: Context) -> None:
        self.inside, self.out = self.inside - 1, self.out + 1
        if not self.inside:
            moment.emit(eEmpty(moment.time))

    @view("ePicture")
    def picture(self, event: Event) -> Scene:
        return TPlace(0.5, 0.5)(PCount(f"{self.out} out, {self.inside} inside"))


# --- the signs ------------------------------------------------------------------------------------


class Plan(Geometry):
    """A geometric system in which a string is a floor plan: walkable cells and exits."""

    def PWalls(self, cells: np.ndarray) -> None:
        self.free = cells == 0

    def PExit(self, cells: np.ndarray) -> None:
        self.exits = cells > 0


class Signs(
    Device, Generator, draws=("eBody",), coupled=True, events=("eSign",),
    when=f"each {EVERY} frames",
):  # fmt: skip
    """Sends each person the direction of the nearest exit.

    The shortest paths are computed once, on the cells of the plan.
    """

    def joined(self, world: WorldInfo) -> None:
        self._bodies = Bodies(world.vocabulary)
        self._ahead: np.ndarray | None = None
        self._signs: tuple[Events, ...] = ()
        self._shown, self._inside, self._seconds = -EVERY, 0, 0.0

    def show(self, view: View) -> None:
        if self._ahead is None:
            plan = Plan()
            interpret(view.scene, plan)
            self._ahead = two_steps_ahead(plan.free, plan.exits)
        bodies = self._bodies.volumes(view.skeleton, view.parts)
        people = np.flatnonzero(bodies.owners != "")
        places = bodies.points[bodies.first[people]]
        self._signs = self._directions(places, bodies.owners[people])
        self._shown, self._inside = view.frame, len(people)

    def _directions(self, places: np.ndarray, who: np.ndarray) -> tuple[Events, ...]:
        if not len(who):
            return ()
        cells = np.clip((places / CELL).astype(int), 0, np.array(self._ahead.shape[:2]) - 1)
        way = self._ahead[cells[:, 0], cells[:, 1]] - places
        length = np.sqrt(way[:, 0] ** 2 + way[:, 1] ** 2)
        dx, dy = (way / np.maximum(length, 1e-9)[:, None]).T.copy()
        return (eSign(dx, dy, receivers=Ids.of(who.tolist())),)

    def generate(self, tick: Tick) -> Iterable[Events]:
        if self._inside:
            self._seconds = tick.time
        return self._signs if self._shown == tick.number - 1 else ()

    def save(self) -> Mapping[str, float]:
        return {"seconds": self._seconds}

    def restore(self, saved: Mapping[str, float]) -> None:
        self._seconds = saved["seconds"]

    def report(self) -> Mapping[str, float]:
        return {"inside": self._inside, "seconds": round(self._seconds, 2)}


def two_steps_ahead(free: np.ndarray, exits: np.ndarray) -> np.ndarray:
    """Target from each cell, (rows, columns, 2) metres: the centre of the cell two steps on."""
    step: dict[tuple[int, int], tuple[int, int]] = {}
    queue = [(0.0, cell, cell) for cell in map(tuple, np.argwhere(exits).tolist())]
    while queue:
        far, cell, towards = heapq.heappop(queue)
        if cell in step:
            continue
        step[cell] = towards
        for beside, distance in around(cell, free):
            if beside not in step:
                heapq.heappush(queue, (far + distance, beside, cell))
    ahead = (np.indices(free.shape).transpose(1, 2, 0) + 0.5) * CELL
    for cell, towards in step.items():
        x, y = step[towards]
        ahead[cell] = (x + 0.5) * CELL, (y + 0.5) * CELL
    return ahead


def around(cell: tuple[int, int], free: np.ndarray) -> Iterable[tuple[tuple[int, int], float]]:
    """The neighbours of a cell with their distances; diagonals must not cut a wall's corner."""
    x, y = cell
    for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1)):
        there = x + dx, y + dy
        if all(0 <= a < size for a, size in zip(there, free.shape, strict=True)) and (
            free[there] and free[x, y + dy] and free[x + dx, y]
        ):
            yield there, portable.hypot(dx, dy)


# --- the world ------------------------------------------------------------------------------------

vocabulary = Vocabulary.of(
    *(PWalls, PExit, PBody, PWalker, PStuck, PCount, TPlace),
    *(eBody, ePicture, eSign, eNear, eCollision, eOut, eEmpty),
    *(Person, Building),
)


def scene(options: Mapping[str, Any]) -> Scene:
    """The building of a plan, with people at random positions, at most one per cell."""
    lines = Path(options["plan"]).read_text(encoding="utf-8").splitlines()
    width, count = max(map(len, lines)), options["people"]
    signs = np.array([list(line.ljust(width)) for line in reversed(lines)]).T  # x, y
    if not (signs == EXIT).any():
        raise MinervaError(f"crowd: {options['plan']} has no exit; write an E into a wall")
    room = np.argwhere(signs == FREE)
    if not 0 < count <= len(room):
        raise MinervaError(f"crowd: {count} people; expected 1 to {len(room)}, one for each cell")
    chance = np.random.default_rng(options["crowd"])
    x, y = ((chance.permutation(room)[:count] + 0.5) * CELL).T.copy()
    people = Person.many("p", count, x=x, y=y, pace=chance.uniform(1.0, 1.6, count))
    walls, exits = (signs == WALL).astype(np.int16), (signs == EXIT).astype(np.int16)
    return PWalls(walls) + PExit(exits) + Building("building", inside=count).string + people
