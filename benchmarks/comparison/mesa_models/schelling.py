"""Segregation in Mesa."""

# Mesa's classes have attributes of the model, which its annotations do not know.
# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false
# pyright: reportArgumentType=false, reportCallIssue=false

from __future__ import annotations

import numpy as np
from mesa import Model
from mesa.discrete_space import CellAgent, OrthogonalMooreGrid

from benchmarks.comparison.figures import of_town
from benchmarks.comparison.parameters import Schelling


class Resident(CellAgent):
    def __init__(self, model, group, cell):
        super().__init__(model)
        self.group = group
        self.cell = cell
        self.happy = False

    def step(self):
        p = self.model.p
        similar = 0
        for neighbour in self.cell.get_neighborhood(radius=p.radius).agents:
            if neighbour.group == self.group:
                similar += 1
        self.happy = similar >= p.wanted
        if not self.happy:
            self.cell = self.model.grid.select_random_empty_cell()


class Town(Model):
    def __init__(self, p: Schelling, seed: int):
        super().__init__(seed=seed)
        self.p = p
        self.grid = OrthogonalMooreGrid((p.side, p.side), capacity=1, random=self.random)
        cells = self.random.sample(self.grid.all_cells.cells, p.agents)
        groups = [1 + 2 * number // p.agents for number in range(p.agents)]
        Resident.create_agents(self, p.agents, groups, cells)

    def step(self):
        self.agents.shuffle_do("step")


def run(p: Schelling, seed: int):
    """Run the model; returns the function that computes its statistics."""
    model = Town(p, seed)
    for _ in range(p.steps):
        model.step()

    def figures():
        groups = np.zeros((p.side, p.side), int)
        for resident in model.agents:
            groups[resident.cell.coordinate] = resident.group
        return of_town(groups, p.radius, p.wanted)

    return figures
