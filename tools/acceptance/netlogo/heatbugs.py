"""Heatbugs (Wilensky 2004): bugs warm the ground, and go where it is as warm as they like."""

import numpy as np

from minerva_bus import Reals, on
from minerva_fast import (
    SHUFFLED,
    Column,
    Draws,
    OnLattice,
    Space,
    beside,
    integers,
    move_to,
    rule,
    within,
)
from tools.acceptance.netlogo.primitives import AROUND, diffuse, ticking

SIDE, BUGS, DIFFUSION, EVAPORATION, IDEAL, OUTPUT = 100, 100, 0.9, 0.01, (10, 40), (5, 25)


class Bug(OnLattice):
    ideal: Column
    output: Column
    unhappiness: Column


@rule(SHUFFLED)
def step(i: int, bugs: Bug, level: Reals, draws: Draws):
    here = bugs.cell[i]
    bugs.unhappiness[i] = abs(bugs.ideal[i] - level[here])
    sign = 1.0 if level[here] < bugs.ideal[i] else -1.0  # to warmth or to cold
    goal, count, free, vacant = here, 0, here, 0
    for dx, dy in AROUND:
        cell = beside(bugs.lattice, here, dx, dy)
        gain = sign * (level[cell] - level[goal])
        count = 1 if gain > 0 else count + (gain == 0)
        if gain > 0 or (gain == 0 and goal != here and integers(draws, count) == 0):
            goal = cell
        if within(bugs, cell, 0) == 0:
            vacant += 1
            if integers(draws, vacant) == 0:
                free = cell
    if bugs.unhappiness[i] > 0 and goal != here:
        move_to(bugs, i, free if within(bugs, goal, 0) > 0 else goal)
    level[bugs.cell[i]] += bugs.output[i]


class Ground(Space, symbol="AGround"):
    bugs: Reals
    level: Reals

    @on("eStep")
    def step(self, event, moment):
        self.run(moment, diffuse, step, share=DIFFUSION, evaporation=EVAPORATION)


def world(seed):
    random = np.random.default_rng(seed)
    bugs = Bug.many(BUGS, cell=random.permutation(SIDE**2)[:BUGS], unhappiness=0,
                    ideal=random.integers(*IDEAL, BUGS),
                    output=random.integers(*OUTPUT, BUGS))  # fmt: skip
    ground = Ground("ground", width=SIDE, height=SIDE, periodic=True, births=BUGS,
                    bugs=bugs, level=np.zeros((SIDE, SIDE)))  # fmt: skip
    return ticking(ground)


def shown(state):
    """Columns and rows of the bugs, and their unhappiness."""
    bugs = Bug.read(state["bugs"])
    return bugs.cell % SIDE, bugs.cell // SIDE, bugs.unhappiness
