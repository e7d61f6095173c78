"""Wealth exchange in Mesa."""

# Mesa's classes have attributes of the model, which its annotations do not know.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import numpy as np
from mesa import Agent, Model

from benchmarks.comparison.figures import of_wealth
from benchmarks.comparison.parameters import Wealth


class Person(Agent):
    def __init__(self, model):
        super().__init__(model)
        self.coins = 1

    def step(self):
        if self.coins > 0:
            self.coins -= 1
            self.random.choice(self.model.people).coins += 1


class Town(Model):
    def __init__(self, p: Wealth, seed: int):
        super().__init__(seed=seed)
        self.people = list(Person.create_agents(self, p.people))

    def step(self):
        self.agents.shuffle_do("step")


def run(p: Wealth, seed: int):
    """Run the model; returns the function that computes its statistics."""
    model = Town(p, seed)
    for _ in range(p.steps):
        model.step()
    return lambda: of_wealth(np.array([person.coins for person in model.people]))
