"""Birds in Mesa."""

# Mesa's classes have attributes of the model, which its annotations do not know.
# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false
# pyright: reportArgumentType=false, reportCallIssue=false

from __future__ import annotations

import numpy as np
from mesa import Model
from mesa.experimental.continuous_space import ContinuousSpace, ContinuousSpaceAgent

from benchmarks.comparison.figures import of_flock
from benchmarks.comparison.parameters import Flocking


class Bird(ContinuousSpaceAgent):
    def __init__(self, model, space, position, direction):
        super().__init__(space, model)
        self.position = position
        self.direction = direction

    def step(self):
        p = self.model.p
        neighbours, distances = self.get_neighbors_in_radius(radius=p.sight)
        if neighbours:
            delta = self.space.calculate_difference_vector(self.position, agents=neighbours)
            cohere = delta.sum(axis=0) * p.cohere
            separate = -delta[distances < p.separation].sum(axis=0) * p.separate
            match = np.sum([bird.direction for bird in neighbours], axis=0) * p.match
            self.direction = self.direction + (cohere + separate + match) / len(neighbours)
        self.direction = self.direction / np.linalg.norm(self.direction)
        self.position = self.position + self.direction * p.speed


class Flock(Model):
    def __init__(self, p: Flocking, seed: int):
        super().__init__(seed=seed)
        self.p = p
        self.space = ContinuousSpace([[0, p.side], [0, p.side]], torus=True, random=self.random,
                                     n_agents=p.birds)  # fmt: skip
        positions = self.rng.random((p.birds, 2)) * p.side
        directions = self.rng.uniform(-1, 1, (p.birds, 2))
        Bird.create_agents(self, p.birds, self.space, positions, directions)

    def step(self):
        self.agents.shuffle_do("step")


def run(p: Flocking, seed: int):
    """Run the model; returns the function that computes its statistics."""
    model = Flock(p, seed)
    for _ in range(p.steps):
        model.step()

    def figures():
        birds = list(model.agents)
        position = np.array([bird.position for bird in birds])
        direction = np.array([bird.direction for bird in birds])
        return of_flock(*position.T, *direction.T)

    return figures
