"""Wealth exchange in Minerva Bus: a matrix with the coins of each person."""

from __future__ import annotations

import numpy as np

from benchmarks.comparison.figures import of_wealth
from benchmarks.comparison.parameters import Wealth
from benchmarks.comparison.stepping import stepped
from minerva_bus import Cells, on
from minerva_fast import ORDERED, Draws, Space, integers, rule


@rule(ORDERED)
def give(i: int, coins: Cells, draws: Draws):
    if coins[i] > 0:
        coins[i] -= 1
        coins[integers(draws, 0, len(coins))] += 1


class Town(Space, symbol="ATown"):
    coins: Cells

    @on("eStep")
    def step(self, step, moment):
        self.run(moment, give)


def run(p: Wealth, seed: int):
    """Run the model; returns the function that computes its statistics."""
    town = Town("town", width=p.people, coins=np.ones((1, p.people), np.int16))
    coins = stepped(town, p.steps, seed)["coins"]
    return lambda: of_wealth(coins[0])
