"""A forest fire in Minerva Bus."""

from __future__ import annotations

import numpy as np

from benchmarks.comparison.parameters import ForestFire
from benchmarks.comparison.stepping import stepped
from minerva_bus import Cells, on
from minerva_fast import SIMULTANEOUS, CellGrid, Space, beside, rule

TREE, FIRE, BURNT = 1, 2, 3


@rule(SIMULTANEOUS)
def burn(cell: int, forest: Cells, before: Cells, lattice: CellGrid):
    if before[cell] == FIRE:
        forest[cell] = BURNT
    elif before[cell] == TREE:
        for dx, dy in ((0, 1), (0, -1), (1, 0), (-1, 0)):
            other = beside(lattice, cell, dx, dy)
            if other >= 0 and before[other] == FIRE:
                forest[cell] = FIRE


class Forest(Space, symbol="AForest"):
    forest: Cells

    @on("eStep")
    def step(self, step, moment):
        self.run(moment, burn)


def run(p: ForestFire, seed: int):
    """Run the model; returns the function that computes its statistics."""
    forest = (np.random.default_rng(seed).random((p.side, p.side)) < p.density).astype(np.int16)
    trees = forest.sum()
    forest[:, 0] *= FIRE
    space = Forest("forest", width=p.side, height=p.side, forest=forest)
    final = stepped(space, p.steps, seed)["forest"]
    return lambda: {"burnt": float((final == BURNT).sum() / trees)}
