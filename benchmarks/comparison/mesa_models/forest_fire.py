"""A forest fire in Mesa."""

# Mesa's classes have attributes of the model, which its annotations do not know.
# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false
# pyright: reportArgumentType=false, reportCallIssue=false

from __future__ import annotations

from mesa import Model
from mesa.discrete_space import FixedAgent, OrthogonalVonNeumannGrid

from benchmarks.comparison.parameters import ForestFire


class Tree(FixedAgent):
    def __init__(self, model, cell):
        super().__init__(model)
        self.cell = cell
        self.condition = "on fire" if cell.coordinate[0] == 0 else "fine"

    def step(self):
        if self.condition == "on fire":
            for neighbour in self.cell.neighborhood.agents:
                if neighbour.condition == "fine":
                    neighbour.condition = "catches fire"
            self.condition = "burnt"

    def advance(self):
        if self.condition == "catches fire":
            self.condition = "on fire"


class Forest(Model):
    def __init__(self, p: ForestFire, seed: int):
        super().__init__(seed=seed)
        self.grid = OrthogonalVonNeumannGrid((p.side, p.side), capacity=1, random=self.random)
        for cell in self.grid.all_cells:
            if self.random.random() < p.density:
                Tree(self, cell)

    def step(self):
        self.agents.do("step")
        self.agents.do("advance")


def run(p: ForestFire, seed: int):
    """Run the model; returns the function that computes its statistics."""
    model = Forest(p, seed)
    for _ in range(p.steps):
        model.step()
    trees = model.agents
    return lambda: {"burnt": sum(tree.condition == "burnt" for tree in trees) / len(trees)}
