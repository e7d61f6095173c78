"""A small meadow, a flock and a town for the tests of spaces."""

import numpy as np

from minerva_bus import Cells, EventType, Reals, on
from minerva_bus.world.context import Context, Frame
from minerva_fast import (
    ORDERED,
    SHUFFLED,
    SIMULTANEOUS,
    Column,
    Draws,
    InField,
    OnLattice,
    Space,
    chance,
    copy,
    go_to,
    move_to,
    near,
    next_cell,
    random_at,
    random_free,
    remove,
    rule,
    within,
)

eStep = EventType("eStep")


class Sheep(OnLattice):
    energy: Column


@rule(SHUFFLED)
def graze(i: int, sheep: Sheep, grass: Cells, breed: float, draws: Draws):
    move_to(sheep, i, next_cell(sheep.lattice, sheep.cell[i], draws))
    sheep.energy[i] -= 1
    if grass[sheep.cell[i]] == 0:
        sheep.energy[i] += 3
        grass[sheep.cell[i]] = 5
    if sheep.energy[i] < 0:
        remove(sheep, i)
    elif chance(draws, breed):
        sheep.energy[i] /= 2
        copy(sheep, i)


@rule(SHUFFLED)
def hunt(i: int, wolves: Sheep, sheep: Sheep, draws: Draws):
    move_to(wolves, i, next_cell(wolves.lattice, wolves.cell[i], draws))
    prey = random_at(sheep, wolves.cell[i], draws)
    if prey >= 0:
        remove(sheep, prey)
        wolves.energy[i] += 1


@rule(ORDERED)
def grow(cell: int, grass: Cells):
    if grass[cell] > 0:
        grass[cell] -= 1


class Meadow(Space, symbol="AMeadow"):
    sheep: Reals
    wolves: Reals
    grass: Cells

    @on("eStep")
    def step(self, step, moment):
        self.run(moment, graze, hunt, grow, breed=0.3)


def meadow(side=12, sheep=40, wolves=10, name="m"):
    chosen = np.random.default_rng(1)
    return Meadow(
        name,
        width=side,
        height=side,
        births=sheep + wolves,
        sheep=Sheep.many(sheep, cell=chosen.integers(0, side**2, sheep), energy=2.0),
        wolves=Sheep.many(wolves, first=sheep, cell=chosen.integers(0, side**2, wolves), energy=0),
        grass=np.zeros((side, side), np.int16),
    )


class Bird(InField):
    seen: Column
    sum_x: Column
    sum_y: Column


@rule(SIMULTANEOUS, births=0)
def look(i: int, birds: Bird, before: Bird, sight: float):
    birds.seen[i] = near(before, before.x[i], before.y[i], sight, i)
    birds.sum_x[i] = birds.sum_y[i] = 0.0
    for k in range(int(birds.seen[i])):
        birds.sum_x[i] += before.dx[k]
        birds.sum_y[i] += before.dy[k]


@rule(SHUFFLED, births=0)
def drift(i: int, birds: Bird, draws: Draws):
    go_to(birds, i, birds.x[i] + chance(draws, 0.5), birds.y[i] - 1.0)


class Flock(Space, symbol="AFlock"):
    birds: Reals
    sight: float

    @on("eStep")
    def step(self, step, moment):
        self.run(moment, drift, look)


def flock(count=60, width=30.0, height=20.0, periodic=True, sight=4.0, part=1.0):
    x, y = np.random.default_rng(2).random((2, count)) * part * [[width], [height]]
    birds = Bird.many(count, x=x, y=y, seen=0, sum_x=0, sum_y=0)
    return Flock("f", width=width, height=height, periodic=periodic, births=count, birds=birds,
                 sight=sight)  # fmt: skip


class Resident(OnLattice):
    near: Column


@rule(SHUFFLED, births=0)
def settle(i: int, residents: Resident, radius: int, draws: Draws):
    residents.near[i] = within(residents, residents.cell[i], radius)
    if residents.near[i] < 2:
        move_to(residents, i, random_free(residents, draws))


@rule(ORDERED, births=0)
def count_near(i: int, residents: Resident, radius: int):
    residents.near[i] = within(residents, residents.cell[i], radius)


class Town(Space, symbol="ATown"):
    residents: Reals

    @on("eStep")
    def step(self, step, moment):
        self.run(moment, settle, radius=1)


def town(count=30, side=8, periodic=False):
    cell = np.random.default_rng(3).permutation(side**2)[:count]
    return Town("t", width=side, height=side, periodic=periodic, births=count,
                residents=Resident.many(count, cell=cell, near=0))  # fmt: skip


def moment(frame=0, who="#m", seed=1):
    return Context(Frame(frame, seed=seed), who)
