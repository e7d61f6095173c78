"""Schelling's segregation (1971) as Mesa's example has it: who has too few of their kind around
them moves to a vacant cell, anywhere.

Vacancies are agents too. One step takes four frames: the service looks at where residents are;
those who are told that they are unhappy ask a vacancy, any; a vacancy gives its place to the first
of them and takes over theirs; they move. So all residents decide at once, by what was before the
step, and who was not the first stays for this step; Mesa's move one after another, and each finds
a place.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minerva_bus import (
    Agent,
    BatchContext,
    Context,
    Event,
    EventBatch,
    EventType,
    Primitive,
    Scene,
    Vocabulary,
    on,
    view,
)
from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.ids import Ids
from minerva_bus.world.services import Service
from minerva_services.physics.neighbours import Neighbours
from minerva_services.physics.neighbours.lattice import Lattice

NAME = "schelling"
CYCLE = 4
order = ("eKey", "eAsk", "eNear")

DENSITY = 0.8
HOMOPHILY = 0.4
RADIUS = 1

# The names that event types have in the string are theirs here too.
PSpot = Primitive("PSpot", who=str, x=int, y=int, colour=int)
eWhere = EventType("eWhere", visual=True)
eNear = EventType("eNear", number=int, same=int)
eAsk = EventType("eAsk", x=int, y=int)
eKey = EventType("eKey", x=int, y=int)


class Resident(Agent, symbol="AResident"):
    """Somebody of one kind or the other; `vacancies` is how many there are to choose from."""

    x: int
    y: int
    colour: int
    vacancies: int
    happy: bool = False

    @on("eNear", population=True)
    def judge(self, near: Event, moment: BatchContext) -> None:
        self.happy = near.same / np.maximum(near.number, 1) >= HOMOPHILY
        sad = np.flatnonzero(~self.happy)
        vacancy = moment.chance.of(sad).integers(self.vacancies[sad])
        to = Ids.numbered("v", vacancy)
        moment.emit(eAsk(self.x[sad], self.y[sad], receivers=to), where=~self.happy)

    @on("eKey", population=True)
    def move(self, key: Event, moment: BatchContext) -> None:
        self.x, self.y = key.x, key.y

    @view("eWhere", population=True)
    def where(self, event: Event) -> Scene:
        return PSpot(self.id, self.x, self.y, self.colour)


class Vacancy(Agent, symbol="AVacancy"):
    """A cell that nobody lives in."""

    x: int
    y: int

    @on("eAsk", together=True)
    def give(self, asked: EventBatch, moment: BatchContext) -> None:
        first = np.unique(asked.row, return_index=True)[1]
        moment.emit(eKey(self.x, self.y, receivers=asked.sender.take(first)))
        self.x, self.y = asked.x[first], asked.y[first]


class PlainResident(Agent, symbol="AResident"):
    """The same as Resident, written for one."""

    x: int
    y: int
    colour: int
    vacancies: int
    happy: bool = False

    @on("eNear")
    def judge(self, near: Event, moment: Context) -> None:
        self.happy = near.same / max(near.number, 1) >= HOMOPHILY
        if not self.happy:
            vacancy = moment.chance.integers(self.vacancies)
            moment.emit(eAsk(self.x, self.y, receivers=[f"v{vacancy}"]))

    @on("eKey")
    def move(self, key: Event, moment: Context) -> None:
        self.x, self.y = key.x, key.y

    @view("eWhere")
    def where(self, event: Event) -> Scene:
        return PSpot(self.id, self.x, self.y, self.colour)


class PlainVacancy(Agent, symbol="AVacancy"):
    """The same as Vacancy, written for one."""

    x: int
    y: int
    _given: bool = False  # a name with _ is no state: it lasts for one frame

    @on("eAsk")
    def give(self, ask: Event, moment: Context) -> None:
        if not self._given:
            self._given = True
            moment.emit(eKey(self.x, self.y, receivers=[ask.sender]))
            self.x, self.y = ask.x, ask.y


kinds: list[type[Agent]] = [Resident, Vacancy]
plain_kinds: list[type[Agent]] = [PlainResident, PlainVacancy]
vocabulary = Vocabulary.of(PSpot, eWhere, eNear, eAsk, eKey, Resident, Vacancy)


def side(agents: int) -> int:
    """How many cells long the town's edges are."""
    return math.ceil(math.sqrt(agents / DENSITY))


def scene(agents: int, seed: int) -> Scene:
    """Residents of two kinds anywhere, and vacancies everywhere else."""
    chance, width = np.random.default_rng(seed), side(agents)
    x, y = np.divmod(chance.permutation(width * width), width)
    free = width * width - agents
    residents = Resident.many(
        "r",
        agents,
        x=x[:agents],
        y=y[:agents],
        colour=chance.integers(0, 2, agents),
        vacancies=free,
    )
    return residents + Vacancy.many("v", free, x=x[agents:], y=y[agents:])


def services(agents: int) -> dict[str, Callable[[], Service]]:
    """Who tells residents who is near them."""
    width = side(agents)
    look = partial(Neighbours, every=CYCLE, grid=True, width=width, height=width, radius=RADIUS)
    return {"neighbours": partial(look, same="colour")}


def updates_per_frame(agents: int) -> int:
    """Every resident acts in every fourth frame."""
    return agents // CYCLE


def statistics(scene: Scene) -> dict[str, float]:
    """How happy residents are, and how much they are among their kind."""
    parts = [p for p in scene.pieces if isinstance(p, Columns) and p.symbol == "AResident"]
    x, y, kind = (np.concatenate([p.column(name) for p in parts]) for name in ("x", "y", "colour"))
    return segregation(x, y, kind, side(len(x)))


def segregation(
    x: NDArray[Any], y: NDArray[Any], kind: NDArray[Any], width: int
) -> dict[str, float]:
    """Also for residents who come from elsewhere."""
    lattice = Lattice(width, width, RADIUS, "moore", periodic=False)
    cells = x * width + y
    number, same = lattice.like(cells, kind)
    share = same / np.maximum(number, 1)
    return {"happy": float((share >= HOMOPHILY).mean()), "similar": float(share[number > 0].mean())}
