"""Wealth exchange in AgentPy."""

# pyright: reportMissingImports=false, reportMissingTypeStubs=false, reportUntypedBaseClass=false
# pyright: reportIncompatibleMethodOverride=false, reportOptionalCall=false

from __future__ import annotations

import agentpy
import numpy as np

from benchmarks.comparison.figures import of_wealth
from benchmarks.comparison.parameters import Wealth


class Person(agentpy.Agent):
    def setup(self):
        self.coins = 1

    def give(self):
        if self.coins > 0:
            self.coins -= 1
            self.model.random.choice(self.model.people).coins += 1


class Town(agentpy.Model):
    def setup(self):
        self.people = agentpy.AgentList(self, self.p.people, Person)

    def step(self):
        self.people.shuffle().give()


def run(p: Wealth, seed: int):
    """Run the model; returns the function that computes its statistics."""
    model = Town({"people": p.people, "steps": p.steps, "seed": seed})
    model.run(display=False)
    return lambda: of_wealth(np.array([person.coins for person in model.people]))
