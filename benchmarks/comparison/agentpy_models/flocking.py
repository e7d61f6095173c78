"""Birds in AgentPy."""

# pyright: reportMissingImports=false, reportMissingTypeStubs=false, reportUntypedBaseClass=false
# pyright: reportIncompatibleMethodOverride=false, reportOptionalCall=false

from __future__ import annotations

import agentpy
import numpy as np

from benchmarks.comparison.figures import of_flock
from benchmarks.comparison.parameters import Flocking


class Bird(agentpy.Agent):
    def setup(self):
        self.velocity = self.model.nprandom.uniform(-1, 1, 2)

    def fly(self):
        p, field = self.p.flocking, self.model.field
        place, steer = field.positions[self], np.zeros(2)
        others = field.neighbors(self, p.sight).to_list()
        for other in others:
            apart = field.positions[other] - place
            apart -= p.side * np.round(apart / p.side)
            steer += p.cohere * apart + p.match * other.velocity
            if apart @ apart < p.separation**2:
                steer -= p.separate * apart
        self.velocity = self.velocity + steer / max(len(others), 1)
        self.velocity /= np.sqrt(self.velocity @ self.velocity)
        field.move_by(self, p.speed * self.velocity)


class Flock(agentpy.Model):
    def setup(self):
        p = self.p.flocking
        self.field = agentpy.Space(self, shape=[p.side, p.side], torus=True)
        self.birds = agentpy.AgentList(self, p.birds, Bird)
        self.field.add_agents(self.birds, random=True)

    def step(self):
        self.birds.shuffle().fly()


def run(p: Flocking, seed: int):
    """Run the model; returns the function that computes its statistics."""
    model = Flock({"flocking": p, "steps": p.steps, "seed": seed})
    model.run(display=False)
    places = np.array([model.field.positions[bird] for bird in model.birds])
    velocities = np.array([bird.velocity for bird in model.birds])
    return lambda: of_flock(*places.T, *velocities.T)
