"""Ants (Wilensky 1997): ants carry food to the nest, and lay and follow trails of a chemical."""

import math

import numpy as np

from minerva_bus import Cells, Reals, on, portable
from minerva_fast import SHUFFLED, Column, Draws, Space, integers, rule
from tools.acceptance.netlogo.primitives import OUTSIDE, Turtle, diffuse, stand, ticking

SIDE, ANTS, DIFFUSION, EVAPORATION, TURN = 71, 125, 0.5, 0.1, math.pi / 4


class Ant(Turtle):
    heading: Column
    loaded: Column


def ahead(ants, i, angle):
    """The cell one step ahead at an angle, or OUTSIDE."""
    x = math.floor(ants.x[i] + portable.cos(ants.heading[i] + angle))
    y = math.floor(ants.y[i] + portable.sin(ants.heading[i] + angle))
    return y * SIDE + x if 0 <= x < SIDE and 0 <= y < SIDE else OUTSIDE


def climb(ants, i, scent):
    strongest, turn = -1.0, 0.0
    for angle in (0.0, TURN, -TURN):
        cell = ahead(ants, i, angle)
        smell = 0.0 if cell == OUTSIDE else scent[cell]
        if smell > strongest:
            strongest, turn = smell, angle
    ants.heading[i] += turn


@rule(SHUFFLED)
def forage(i: int, ants: Ant, food: Cells, level: Reals, nest: Reals, ticks: int, draws: Draws):
    if i >= ticks:  # They leave the nest one by one.
        return
    here = ants.cell[i]
    if ants.loaded[i] == 1 and nest[here] > 195:
        ants.loaded[i], ants.heading[i] = 0, ants.heading[i] + math.pi
    elif ants.loaded[i] == 1:
        level[here] += 60
        climb(ants, i, nest)
    elif food[here] > 0:
        ants.loaded[i], ants.heading[i] = 1, ants.heading[i] + math.pi
        food[here] -= 1
    elif 0.05 <= level[here] < 2:
        climb(ants, i, level)
    ants.heading[i] += (integers(draws, 40) - integers(draws, 40)) * math.pi / 180
    if ahead(ants, i, 0.0) == OUTSIDE:
        ants.heading[i] += math.pi
    if ahead(ants, i, 0.0) != OUTSIDE:
        dx, dy = portable.cos(ants.heading[i]), portable.sin(ants.heading[i])
        stand(ants, i, ants.x[i] + dx, ants.y[i] + dy)


class Colony(Space, symbol="AColony"):
    ants: Reals
    food: Cells
    level: Reals  # of the chemical
    nest: Reals  # its scent
    piles: tuple[int, ...] = ()

    @on("eStep")
    def step(self, step, moment):
        self.run(moment, forage, ticks=moment.number)
        self.run(moment, diffuse, share=DIFFUSION, evaporation=EVAPORATION)
        self.piles = tuple(int(self.food[pile].sum()) for pile in PILES)


def distance(x, y):
    """From each cell to a place in the range -1 to 1, in cells."""
    rows, columns = np.mgrid[:SIDE, :SIDE] - SIDE // 2
    return np.hypot(columns - x * (SIDE // 2), rows - y * (SIDE // 2))


PILES = tuple(distance(x, y) < 5 for x, y in ((0.6, 0), (-0.6, -0.6), (-0.8, 0.8)))


def world(seed):
    draw = np.random.default_rng(seed)
    food = np.where(np.any(PILES, axis=0), draw.integers(1, 3, (SIDE, SIDE)), 0)
    ants = Ant.many(ANTS, cell=SIDE**2 // 2, x=SIDE / 2, y=SIDE / 2, loaded=0,
                    heading=draw.uniform(0, 2 * np.pi, ANTS))  # fmt: skip
    return ticking(Colony("colony", width=SIDE, height=SIDE, births=ANTS, ants=ants, food=food,
                          level=np.zeros((SIDE, SIDE)), nest=200 - distance(0, 0)))  # fmt: skip


def shown(state):
    """The food in each pile."""
    return (state["piles"],)
