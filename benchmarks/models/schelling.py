"""Schelling's segregation model (1971) as in Mesa's example.

Residents with too few similar neighbours move to a random vacant cell. Vacancies are agents too. A
step takes four frames: the service determines the positions of residents; unhappy residents ask a
random vacancy; the vacancy gives its cell to the first of them and takes over the old cell; they
move. All residents therefore decide simultaneously on the state before the step, and a resident
that is not the first stays for this step; in Mesa they move one after another, and each finds a
cell.
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
    EventBatch,
    EventType,
    Primitive,
    Scene,
    Vocabulary,
    on,
    view,
)
from minerva_bus.grammar.ids import Ids
from minerva_bus.world.services import Service
from minerva_services.physics.neighbours import Neighbours

NAME = "schelling"
CYCLE = 4
order = ("eKey", "eAsk", "eNear")

DENSITY = 0.8
HOMOPHILY = 0.4
RADIUS = 1

# Variables have the names of their symbols in the string.
PSpot = Primitive("PSpot", who=str, x=int, y=int, colour=int)
eWhere = EventType("eWhere", visual=True)
eNear = EventType("eNear", number=int, same=int)
eAsk = EventType("eAsk", x=int, y=int)
eKey = EventType("eKey", x=int, y=int)


class Resident(Agent, symbol="AResident"):
    """A resident of one of two colours; `vacancies` is the number of vacant cells."""

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
    """A cell without a resident."""

    x: int
    y: int

    @on("eAsk", together=True)
    def give(self, asked: EventBatch, moment: BatchContext) -> None:
        first = np.unique(asked.row, return_index=True)[1]
        moment.emit(eKey(self.x, self.y, receivers=asked.sender.take(first)))
        self.x, self.y = asked.x[first], asked.y[first]


class PlainResident(Agent, symbol="AResident"):
    """The same as Resident, with activities for a single agent."""

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
    """The same as Vacancy, with activities for a single agent."""

    x: int
    y: int
    _given: bool = False  # a name with _ is not part of the state: it lasts for one frame

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
    """Number of cells along an edge of the town."""
    return math.ceil(math.sqrt(agents / DENSITY))


def scene(agents: int, seed: int) -> Scene:
    """Residents of two colours at random cells, and vacancies in all others."""
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
    """The service that counts the neighbours of residents."""
    width = side(agents)
    look = partial(Neighbours, every=CYCLE, grid=True, width=width, height=width, radius=RADIUS)
    return {"neighbours": partial(look, same="colour")}


def updates_per_frame(agents: int) -> int:
    """All residents act in every fourth frame."""
    return agents // CYCLE
