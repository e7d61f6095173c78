"""Wolves, sheep and grass in Mesa."""

# Mesa's classes have attributes of the model, which its annotations do not know.
# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false
# pyright: reportArgumentType=false, reportCallIssue=false

from __future__ import annotations

import math

import numpy as np
from mesa import Model
from mesa.discrete_space import CellAgent, OrthogonalMooreGrid

from benchmarks.comparison.parameters import WolfSheep


class Animal(CellAgent):
    def __init__(self, model, energy, cell, breed, gain):
        super().__init__(model)
        self.energy = energy
        self.cell = cell
        self.breed = breed
        self.gain = gain

    def step(self):
        self.cell = self.cell.neighborhood.select_random_cell()
        self.energy -= 1
        self.feed()
        if self.energy < 0:
            self.remove()
        elif self.random.random() < self.breed:
            self.energy /= 2
            type(self)(self.model, self.energy, self.cell, self.breed, self.gain)


class Sheep(Animal):
    def feed(self):
        if self.cell.countdown == 0:
            self.energy += self.gain
            self.cell.countdown = self.model.regrowth


class Wolf(Animal):
    def feed(self):
        sheep = [agent for agent in self.cell.agents if isinstance(agent, Sheep)]
        if sheep:
            self.energy += self.gain
            self.random.choice(sheep).remove()


class Pasture(Model):
    def __init__(self, p: WolfSheep, seed: int):
        super().__init__(seed=seed)
        self.regrowth = p.regrowth
        self.grid = OrthogonalMooreGrid((p.side, p.side), torus=False, capacity=math.inf,
                                        random=self.random)  # fmt: skip
        self.grass = self.grid.create_property_layer("countdown", default_value=0, dtype=int)
        shape = (p.side, p.side)
        grown = self.rng.random(shape) < 0.5
        self.grass.data[:] = np.where(grown, 0, self.rng.integers(1, p.regrowth + 1, shape))
        for kind, count, gain, breed in (
            (Sheep, p.sheep, p.sheep_gain, p.sheep_breed),
            (Wolf, p.wolves, p.wolf_gain, p.wolf_breed),
        ):
            energy = self.rng.integers(0, 2 * int(gain), count).astype(float).tolist()
            cells = self.random.choices(self.grid.all_cells.cells, k=count)
            kind.create_agents(self, count, energy, cells, breed, gain)

    def step(self):
        self.agents_by_type[Sheep].shuffle_do("step")
        self.agents_by_type[Wolf].shuffle_do("step")
        self.grass.data[self.grass.data > 0] -= 1


def run(p: WolfSheep, seed: int):
    """Run the model; returns the function that computes its statistics."""
    model = Pasture(p, seed)
    for _ in range(p.steps):
        model.step()
    return lambda: {
        "sheep": float(len(model.agents_by_type[Sheep])),
        "wolves": float(len(model.agents_by_type[Wolf])),
        "grass": float((model.grass.data == 0).mean()),
    }
