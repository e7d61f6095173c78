"""Wolf Sheep Predation (Wilensky 1997) as in Mesa: sheep avoid wolves, and all go to food."""

import numpy as np

from minerva_bus import Cells, Reals, on
from minerva_fast import (
    ORDERED,
    SHUFFLED,
    Column,
    Draws,
    OnLattice,
    Space,
    beside,
    chance,
    copy,
    integers,
    move_to,
    random_at,
    remove,
    rule,
    within,
)
from tools.acceptance.netlogo.primitives import ticking

SIDE, REGROWTH = 20, 30
SIDES = ((0, 1), (0, -1), (1, 0), (-1, 0))


class Animal(OnLattice):
    energy: Column


@rule(SHUFFLED)
def graze(i: int, sheep: Animal, wolves: Animal, grass: Cells, draws: Draws):
    goal = best_cell(i, sheep, wolves, grass, True, draws)
    live_on(i, sheep, goal, grass[goal] == 0, 4, 0.04, draws)
    if grass[goal] == 0:
        grass[goal] = REGROWTH + 1


@rule(SHUFFLED)
def hunt(i: int, wolves: Animal, sheep: Animal, grass: Cells, draws: Draws):
    goal = best_cell(i, wolves, sheep, grass, False, draws)
    prey = random_at(sheep, goal, draws)
    if prey >= 0:
        remove(sheep, prey)
    live_on(i, wolves, goal, prey >= 0, 20, 0.05, draws)


def best_cell(i, animals, others, grass, flees, draws):
    best, count, goal = 0, 0, animals.cell[i]
    for dx, dy in SIDES:
        cell = beside(animals.lattice, animals.cell[i], dx, dy)
        rank = 2 if grass[cell] == 0 and flees else 1
        if within(others, cell, 0) > 0:
            rank = 0 if flees else 2
        count = 1 if rank > best else count + (rank == best)
        best = max(best, rank)
        if rank == best and rank > 0 and integers(draws, count) == 0:
            goal = cell
    return goal


def live_on(i, animals, goal, eats, gain, breeds, draws):
    move_to(animals, i, goal)
    animals.energy[i] += gain * eats - 1
    if animals.energy[i] < 0:
        remove(animals, i)
    elif chance(draws, breeds):
        animals.energy[i] /= 2
        copy(animals, i)


@rule(ORDERED)
def grow(cell: int, grass: Cells):
    grass[cell] = max(grass[cell] - 1, 0)


class Meadow(Space, symbol="AMeadow"):
    sheep: Reals
    wolves: Reals
    grass: Cells
    counts: tuple[int, ...] = ()  # sheep, wolves and cells with grass

    @on("eStep")
    def step(self, step, moment):
        self.run(moment, graze, hunt)
        grown = int((self.grass == 0).sum())
        self.counts = (self.sheep.shape[1], self.wolves.shape[1], grown)
        self.run(moment, grow)


def world(seed):
    random = np.random.default_rng(seed)

    def animals(count, first, gain):
        cells, energy = random.integers(0, SIDE**2, count), random.uniform(0, 2 * gain, count)
        return Animal.many(count, first=first, cell=cells, energy=energy)

    grass = np.where(random.random(SIDE**2) < 0.5, 0, random.integers(0, REGROWTH, SIDE**2))
    return ticking(Meadow("meadow", width=SIDE, height=SIDE, periodic=True, births=150,
                          sheep=animals(100, 0, 4), wolves=animals(50, 100, 20),
                          grass=grass.reshape(SIDE, SIDE)))  # fmt: skip


def shown(state):
    """Numbers of sheep, wolves, and cells with grass."""
    return state["counts"]
