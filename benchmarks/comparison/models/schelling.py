"""Segregation in Minerva Bus."""

from __future__ import annotations

import numpy as np

from benchmarks.comparison.figures import of_town
from benchmarks.comparison.parameters import Schelling
from benchmarks.comparison.stepping import stepped
from minerva_bus import Reals, on
from minerva_fast import (
    SHUFFLED,
    Column,
    Draws,
    OnLattice,
    Space,
    move_to,
    random_free,
    rule,
    within,
)


class Resident(OnLattice):
    group: Column
    happy: Column


@rule(SHUFFLED)
def settle(i: int, residents: Resident, radius: int, wanted: int, draws: Draws):
    similar = 0
    for k in range(within(residents, residents.cell[i], radius)):
        j = residents.nearby[k]
        similar += j != i and residents.group[j] == residents.group[i]
    residents.happy[i] = similar >= wanted
    if similar < wanted:
        move_to(residents, i, random_free(residents, draws))


class Town(Space, symbol="ATown"):
    residents: Reals
    radius: int
    wanted: int

    @on("eStep")
    def step(self, step, moment):
        self.run(moment, settle)


def run(p: Schelling, seed: int):
    """Run the model; returns the function that computes its statistics."""
    residents = Resident.read(stepped(town(p, seed), p.steps, seed)["residents"])

    def figures():
        groups = np.zeros(p.side**2, int)
        groups[residents.cell] = residents.group
        return of_town(groups.reshape(p.side, p.side), p.radius, p.wanted)

    return figures


def town(p: Schelling, seed: int) -> Town:
    cell = np.random.default_rng(seed).permutation(p.side**2)[: p.agents]
    group = 1 + 2 * np.arange(p.agents) // p.agents
    return Town(
        "town",
        width=p.side,
        height=p.side,
        births=p.agents,
        residents=Resident.many(p.agents, cell=cell, group=group, happy=0),
        radius=p.radius,
        wanted=p.wanted,
    )
