"""Wolves, sheep and grass on a lattice; parameters of Mesa's example (Wilensky 1997).

In each step every sheep moves to a neighbouring cell without wolves, preferably one with grass, and
eats; then every wolf moves to a neighbouring cell, preferably one with sheep, and eats one. Motion
costs energy and food provides it. Animals without energy die, and animals reproduce at random and
share their energy with the child.

Agents perceive only events, so a step takes two frames. In the first, the lattice, a coupled
device, receives a view with all positions. In the second, it processes the animals in random order
and sends each an event with a free cell and whether it has food, given the choices of earlier
animals (in Mesa the grid selects the cell too). The agents themselves move, eat, die and reproduce.
Each cell of grass is an agent that stores when it is grown. Unlike in Mesa, newborn animals cannot
be eaten in the step of their birth.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from minerva_bus import (
    Agent,
    BatchContext,
    Device,
    Event,
    EventType,
    Generator,
    Primitive,
    Scene,
    Tick,
    View,
    Vocabulary,
    on,
    view,
)
from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.events import AnyEvent
from minerva_bus.grammar.ids import Ids
from minerva_bus.world.population import Population
from minerva_bus.world.services import Service

NAME = "wolf_sheep"
CYCLE = 2
COUNTED = ("ASheep", "AWolf")
order = ("eGraze", "eDevoured", "eHunt", "eEaten")

GRASS_GIVES: Final = 4.0
SHEEP_GIVES: Final = 20.0
SHEEP_BREED: Final = 0.04
WOLVES_BREED: Final = 0.05
REGROWTH: Final = 30

eWhere = EventType("eWhere", visual=True)
eGraze = EventType("eGraze", cell=int, food=bool)
eHunt = EventType("eHunt", cell=int, food=bool)
eDevoured = EventType("eDevoured")
eEaten = EventType("eEaten", step=int)
PSheep = Primitive("PSheep", who=str, cell=int, weak=bool)
PWolf = Primitive("PWolf", who=str, cell=int)
PGrass = Primitive("PGrass", grown=int)


class Sheep(Agent, symbol="ASheep"):
    """Eats grass."""

    cell: int = 0
    energy: float = 0.0
    births: int = 0

    @on("eGraze", population=True)
    def graze(self, graze: Event, moment: BatchContext) -> None:
        live_on(self, graze, moment, GRASS_GIVES, SHEEP_BREED)

    @on("eDevoured", population=True)
    def devoured(self, devoured: Event, moment: BatchContext) -> None:
        self.die()

    @view("eWhere", population=True)
    def where(self, event: Event) -> Scene:
        return PSheep(who=self.id, cell=self.cell, weak=self.energy < 1.0)


class Wolf(Agent, symbol="AWolf"):
    """Eats sheep."""

    cell: int = 0
    energy: float = 0.0
    births: int = 0

    @on("eHunt", population=True)
    def hunt(self, hunt: Event, moment: BatchContext) -> None:
        live_on(self, hunt, moment, SHEEP_GIVES, WOLVES_BREED)

    @view("eWhere", population=True)
    def where(self, event: Event) -> Scene:
        return PWolf(who=self.id, cell=self.cell)


class Grass(Agent, symbol="AGrass"):
    """The grass of one cell; it is edible after the step `grown`."""

    grown: int = 0

    @on("eEaten", population=True)
    def eaten(self, eaten: Event, moment: BatchContext) -> None:
        self.grown = eaten.step + REGROWTH

    @view("eWhere", population=True)
    def where(self, event: Event) -> Scene:
        return PGrass(grown=self.grown)


def live_on(flock: Any, food: Any, moment: BatchContext, gives: float, breed: float) -> None:
    """Move, eat, die or reproduce."""
    animals = cast("Population", flock)
    energy = flock.energy - 1.0 + gives * food.food
    starved = energy < 0
    breeding = moment.chance.chance(breed) & ~starved
    energy[breeding] /= 2
    flock.energy, flock.cell = energy, food.cell
    animals.bear(breeding, energy=energy, cell=flock.cell)
    animals.die(starved)


# --- the lattice ---

Cells = NDArray[np.int64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Shown:
    """Positions of all animals, and the state of the grass."""

    sheep: Ids
    at: Cells
    weak: Bools
    """Which sheep starve in this step unless they eat."""
    wolves: Ids
    hunting_at: Cells
    grown: Cells


class Lattice(Device, Generator, draws=("eWhere",), events=("eWhere", *order), coupled=True):
    """A torus of cells that assigns cells and food to animals."""

    def __init__(self, side: int = 20) -> None:
        self._side = side
        self._around = neighbours(side)
        self._shown: Shown | None = None

    def show(self, view: View) -> None:
        self._shown = shown(view.scene)

    def generate(self, tick: Tick) -> Iterator[AnyEvent]:
        if tick.number % CYCLE == 0:
            yield eWhere()
        elif self._shown is not None:
            yield from self._step(self._shown, tick.number // CYCLE + 1, tick.random)

    def _step(self, now: Shown, step: int, chance: np.random.Generator) -> Iterator[AnyEvent]:
        grass = (now.grown < step).astype(np.int8)
        wolves_at = np.zeros(len(grass), np.bool_)
        wolves_at[now.hunting_at] = True
        cell, grazed = allotted(now.at, self._around, wolves_at, grass, chance)
        if len(cell):
            yield eGraze(cell=cell, food=grazed, receivers=now.sheep)
            if grazed.any():
                yield eEaten(step, receivers=Ids.numbered("g", cell[grazed]))
        prey = np.flatnonzero(grazed | ~now.weak)
        there = np.bincount(cell[prey], minlength=len(grass))
        nowhere = np.zeros(len(grass), np.bool_)
        hunted, fed = allotted(now.hunting_at, self._around, nowhere, there, chance)
        if len(hunted):
            yield eHunt(cell=hunted, food=fed, receivers=now.wolves)
            eaten = victims(prey, cell[prey], hunted[fed], chance)
            if len(eaten):
                yield eDevoured(receivers=now.sheep.take(eaten))


def neighbours(side: int) -> Cells:
    """The four neighbours of each cell on a torus, shape (4, cells)."""
    y, x = np.divmod(np.arange(side * side), side)
    around = [((y + 1) % side, x), ((y - 1) % side, x), (y, (x + 1) % side), (y, (x - 1) % side)]
    return np.stack([row * side + column for row, column in around])


def shown(scene: Scene) -> Shown:
    """The positions and states in a view."""
    by_symbol: dict[str, list[Columns]] = {"PSheep": [], "PWolf": [], "PGrass": []}
    for piece in scene.pieces:
        part = piece if isinstance(piece, Columns) else Columns.of([piece])
        by_symbol[part.symbol].append(part)

    def column(symbol: str, name: str, dtype: Any = np.int64) -> NDArray[Any]:
        columns = [part.column(name) for part in by_symbol[symbol]]
        return np.concatenate(columns) if columns else np.empty(0, dtype)

    def who(symbol: str) -> Ids:
        whos = [part.columns[part.names.index("who")] for part in by_symbol[symbol]]
        ids = [who.ids or Ids.of(who.list()) for who in whos]
        return Ids.concatenated(ids) if ids else Ids.of([])

    return Shown(
        who("PSheep"),
        column("PSheep", "cell"),
        column("PSheep", "weak", np.bool_),
        who("PWolf"),
        column("PWolf", "cell"),
        column("PGrass", "grown"),
    )


def allotted(
    at: Cells, around: Cells, shut: Bools, food: NDArray[Any], chance: np.random.Generator
) -> tuple[Cells, Bools]:
    """New cell of each animal, and whether it gets food there; `food` is the amount per cell.

    An animal moves to a neighbouring cell that is not shut and has food left, otherwise to any that
    is not shut, and stays if all are shut. An animal whose food is taken chooses another cell.
    """
    food = food.copy()
    cell, fed = at.copy(), np.zeros(len(at), np.bool_)
    left = chance.permutation(len(at))
    while len(left):
        goes = at[left]
        near = np.take(around, goes, axis=1)
        wanted, tempted = any_of(((food > 0) & ~shut)[near], chance)
        anywhere, moves = any_of(~shut[near], chance)
        moves |= tempted
        wanted = np.where(tempted, wanted, anywhere)
        goes = np.where(moves, near.ravel()[wanted * len(left) + np.arange(len(left))], goes)
        served = first_come(goes, food) & (tempted | ~moves)
        np.subtract.at(food, goes[served], 1)
        cell[left], fed[left] = goes, served
        left = left[tempted & ~served]
    return cell, fed


def any_of(choices: Bools, chance: np.random.Generator) -> tuple[Cells, Bools]:
    """A random true row of each column, and whether there is one; `choices` has four rows."""
    upto = choices.view(np.int8).copy()
    for row in range(1, len(upto)):
        upto[row] += upto[row - 1]
    wanted = (chance.random(choices.shape[1], np.float32) * upto[-1]).astype(np.int8)
    counts = np.zeros(choices.shape[1], np.int64)
    for row in upto[:-1]:
        counts += row <= wanted
    return counts, upto[-1] > 0


def first_come(goes: Cells, food: NDArray[Any]) -> Bools:
    """Which animals arrive before the food of their cell is used up."""
    food, served = food.copy(), np.zeros(len(goes), np.bool_)
    first = np.empty(len(food), np.intp)
    left = np.flatnonzero(food[goes] > 0)
    while len(left):
        cell = goes[left]
        first[cell[::-1]] = left[::-1]  # the first animal of a cell is written last
        now = first[cell] == left
        served[left[now]] = True
        food[cell[now]] -= 1
        left = left[~now & (food[cell] > 0)]
    return served


def victims(prey: Cells, at: Cells, meals: Cells, chance: np.random.Generator) -> Cells:
    """Which prey are eaten: in each cell as many as there are meals, at random."""
    if not len(prey):
        return prey
    order = chance.permutation(len(prey))
    most = int(max(at.max(), meals.max(initial=0))) + 1
    return prey[order[first_come(at[order], np.bincount(meals, minlength=most))]]


# --- the world ---

kinds: list[type[Agent]] = [Sheep, Wolf, Grass]
vocabulary = Vocabulary.of(
    eWhere, eGraze, eHunt, eDevoured, eEaten, PSheep, PWolf, PGrass, Sheep, Wolf, Grass
)


def side_of(agents: int) -> int:
    """Side of the lattice for this number of animals: 20 cells for 150."""
    return max(1, round(20 * (agents / 150) ** 0.5))


def scene(agents: int, seed: int) -> Scene:
    """Two sheep per wolf at random cells; half of the grass is grown."""
    chance = np.random.default_rng(seed)
    cells, wolves = side_of(agents) ** 2, agents // 3
    sheep = agents - wolves
    grown = np.where(chance.random(cells) < 0.5, 0, chance.integers(0, REGROWTH, cells))
    return (
        Sheep.many(
            "s",
            sheep,
            cell=chance.integers(0, cells, sheep),
            energy=chance.random(sheep) * 2 * GRASS_GIVES,
        )
        + Wolf.many(
            "w",
            wolves,
            cell=chance.integers(0, cells, wolves),
            energy=chance.random(wolves) * 2 * SHEEP_GIVES,
        )
        + Grass.many("g", cells, grown=grown)
    )


def services(agents: int) -> dict[str, Callable[[], Service]]:
    """The lattice."""
    return {"lattice": partial(Lattice, side_of(agents))}


def updates_per_frame(agents: int) -> int:
    """Updates at the start; later steps count the kinds in `COUNTED`."""
    return agents // CYCLE
