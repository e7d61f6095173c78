"""Wolves, sheep and grass in Minerva Bus."""

from __future__ import annotations

import numpy as np

from benchmarks.comparison.parameters import WolfSheep
from benchmarks.comparison.stepping import stepped
from minerva_bus import Cells, Reals, on
from minerva_fast import (
    ORDERED,
    SHUFFLED,
    Column,
    Draws,
    OnLattice,
    Space,
    chance,
    copy,
    kernel,
    move_to,
    next_cell,
    random_at,
    remove,
    rule,
)


class Animal(OnLattice):
    energy: Column
    breed: Column
    gain: Column


@rule(SHUFFLED)
def graze(i: int, sheep: Animal, grass: Cells, regrowth: int, draws: Draws):
    move_to(sheep, i, next_cell(sheep.lattice, sheep.cell[i], draws))
    sheep.energy[i] -= 1
    if grass[sheep.cell[i]] == 0:
        sheep.energy[i] += sheep.gain[i]
        grass[sheep.cell[i]] = regrowth
    live_on(sheep, i, draws)


@rule(SHUFFLED)
def hunt(i: int, wolves: Animal, sheep: Animal, draws: Draws):
    move_to(wolves, i, next_cell(wolves.lattice, wolves.cell[i], draws))
    wolves.energy[i] -= 1
    prey = random_at(sheep, wolves.cell[i], draws)
    if prey >= 0:
        wolves.energy[i] += wolves.gain[i]
        remove(sheep, prey)
    live_on(wolves, i, draws)


@kernel
def live_on(animals, i, draws):
    if animals.energy[i] < 0:
        remove(animals, i)
    elif chance(draws, animals.breed[i]):
        animals.energy[i] /= 2
        copy(animals, i)


@rule(ORDERED)
def grow(cell: int, grass: Cells):
    if grass[cell] > 0:
        grass[cell] -= 1


class Meadow(Space, symbol="AMeadow"):
    sheep: Reals
    wolves: Reals
    grass: Cells
    regrowth: int

    @on("eStep")
    def step(self, step, moment):
        self.run(moment, graze, hunt, grow)


def run(p: WolfSheep, seed: int):
    """Run the model; returns the function that computes its statistics."""
    state = stepped(meadow(p, seed), p.steps, seed)
    return lambda: {
        "sheep": float(state["sheep"].shape[1]),
        "wolves": float(state["wolves"].shape[1]),
        "grass": float((state["grass"] == 0).mean()),
    }


def meadow(p: WolfSheep, seed: int) -> Meadow:
    chance, cells = np.random.default_rng(seed), p.side**2

    def animals(count, first, gain, breed):
        energy, cell = chance.integers(0, 2 * gain, count), chance.integers(0, cells, count)
        return Animal.many(count, first=first, cell=cell, energy=energy, breed=breed, gain=gain)

    grown = np.where(chance.random(cells) < 0.5, 0, chance.integers(1, p.regrowth + 1, cells))
    return Meadow(
        "meadow",
        width=p.side,
        height=p.side,
        sheep=animals(p.sheep, 0, p.sheep_gain, p.sheep_breed),
        wolves=animals(p.wolves, p.sheep, p.wolf_gain, p.wolf_breed),
        births=p.sheep + p.wolves,
        grass=grown.reshape(p.side, p.side),
        regrowth=p.regrowth,
    )
