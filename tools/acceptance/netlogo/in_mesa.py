"""The models in Mesa: its own two, and those that it lacks, written from the same descriptions.

Each takes a seed and a number of steps, and returns statistics after the last one.
"""

# Mesa's classes have attributes of the model, which its annotations do not know.
# pyright: basic

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from mesa import Agent, Model
from mesa.examples.advanced.wolf_sheep.agents import Sheep, Wolf
from mesa.examples.advanced.wolf_sheep.model import WolfSheep
from mesa.examples.basic.boid_flockers.model import BoidFlockers
from mesa.experimental.devs import ABMSimulator

from tools.acceptance.netlogo import statistics

AROUND = [(x, y) for x in (-1, 0, 1) for y in (-1, 0, 1) if x or y]


def wolf_sheep(seed: int, steps: int) -> Mapping[str, float]:
    """Mesa's example."""
    simulator = ABMSimulator()
    model = WolfSheep(seed=seed, simulator=simulator)
    simulator.run_for(steps)
    kinds = model.agents_by_type
    grown = model.datacollector.model_vars["Grass"][-1]
    return statistics.wolf_sheep(len(kinds[Sheep]), len(kinds[Wolf]), grown)


def flocking(seed: int, steps: int) -> Mapping[str, float]:
    """Mesa's example."""
    model = BoidFlockers(seed=seed)
    for _ in range(steps):
        model.step()
    birds = list(model.agents)
    x, y = np.array([bird.position for bird in birds]).T
    return statistics.flocking(x, y, *np.array([bird.direction for bird in birds]).T)


class Ground(Model):
    """Cells with a level that diffuses; a torus or not."""

    def __init__(self, seed: int, side: int, share: float, evaporation: float, torus: bool) -> None:
        super().__init__(seed=seed)
        self.side, self.share, self.evaporation, self.torus = side, share, evaporation, torus
        self.level = np.zeros((side, side))  # [x, y]
        self.taken: dict[tuple[int, int], Agent] = {}

    def diffuse(self) -> None:
        wide = np.pad(self.level, 1, mode="wrap" if self.torus else "constant")
        shifted = [wide[1 + x : 1 + x + self.side, 1 + y : 1 + y + self.side] for x, y in AROUND]
        edge = np.pad(np.ones_like(self.level), 1, constant_values=float(self.torus))
        exist = sum(edge[1 + x : 1 + x + self.side, 1 + y : 1 + y + self.side] for x, y in AROUND)
        kept = self.level * (1 - self.share * exist / 8)
        self.level = (kept + self.share / 8 * sum(shifted)) * (1 - self.evaporation)


class Bug(Agent):
    """A bug of Heatbugs."""

    def __init__(self, model: Ground, cell: tuple[int, int]) -> None:
        super().__init__(model)
        self.cell, model.taken[cell] = cell, self
        self.ideal, self.output = 10 + self.random.randrange(30), 5 + self.random.randrange(20)
        self.unhappiness = 0.0

    def step(self) -> None:
        level, (x, y), side = self.model.level, self.cell, self.model.side
        self.unhappiness = abs(self.ideal - level[self.cell])
        around = [((x + dx) % side, (y + dy) % side) for dx, dy in AROUND]
        self.random.shuffle(around)
        choose = max if level[self.cell] < self.ideal else min
        best = choose(around, key=lambda cell: level[cell])
        if choose(level[best], level[self.cell]) != level[self.cell] and self.unhappiness > 0:
            free = [cell for cell in around if cell not in self.model.taken]
            goal = best if best in free else free[0] if free else self.cell
            del self.model.taken[self.cell]
            self.cell, self.model.taken[goal] = goal, self
        level[self.cell] += self.output


def heatbugs(seed: int, steps: int) -> Mapping[str, float]:
    """Heatbugs, from its description."""
    model = Ground(seed, 100, 0.9, 0.01, torus=True)
    for place in model.random.sample(range(100 * 100), 100):
        Bug(model, divmod(place, 100))
    for _ in range(steps):
        model.diffuse()
        model.agents.shuffle_do("step")
    cells = np.array([bug.cell for bug in model.agents])
    return statistics.heatbugs(*cells.T, np.array([bug.unhappiness for bug in model.agents]))


class Ant(Agent):
    """An ant of Ants; places are relative to the middle of the nest."""

    def __init__(self, model: Ground, number: int) -> None:
        super().__init__(model)
        self.x = self.y = 0.0
        self.heading, self.loaded, self.number = self.random.uniform(0, 360), False, number

    def ahead(self, angle: float) -> tuple[float, float]:
        turn = math.radians(self.heading + angle)
        return self.x + math.sin(turn), self.y + math.cos(turn)

    def smell(self, angle: float, scent: np.ndarray) -> float:
        x, y = (math.floor(number + 35.5) for number in self.ahead(angle))
        return scent[x, y] if 0 <= x < 71 and 0 <= y < 71 else 0.0

    def climb(self, scent: np.ndarray) -> None:
        ahead, right, left = (self.smell(angle, scent) for angle in (0, 45, -45))
        if right > ahead or left > ahead:
            self.heading += 45 if right > left else -45

    def step(self) -> None:
        model = self.model
        if self.number >= model.tick:
            return
        cell = math.floor(self.x + 35.5), math.floor(self.y + 35.5)
        if self.loaded:
            if model.nest[cell] > 195:
                self.loaded, self.heading = False, self.heading + 180
            else:
                model.level[cell] += 60
                self.climb(model.nest)
        elif model.food[cell] > 0:
            self.loaded, self.heading = True, self.heading + 180
            model.food[cell] -= 1
        elif 0.05 <= model.level[cell] < 2:
            self.climb(model.level)
        self.heading += self.random.randrange(40) - self.random.randrange(40)
        if max(map(abs, self.ahead(0))) >= 35.5:
            self.heading += 180
        if max(map(abs, self.ahead(0))) < 35.5:
            self.x, self.y = self.ahead(0)


def ants(seed: int, steps: int) -> Mapping[str, float]:
    """Ants, from its description."""
    model = Ground(seed, 71, 0.5, 0.1, torus=False)
    x, y = np.mgrid[-35:36, -35:36]
    model.nest = 200 - np.hypot(x, y)
    places = (21, 0), (-21, -21), (-28, 28)
    piles = [np.hypot(x - px, y - py) < 5 for px, py in places]
    model.food = np.where(sum(piles), model.rng.integers(1, 3, (71, 71)), 0)
    for number in range(125):
        Ant(model, number)
    for tick in range(steps):
        model.tick = tick
        model.agents.shuffle_do("step")
        model.diffuse()
    return statistics.ants([model.food[pile].sum() for pile in piles])


class Person(Agent):
    """A person of AIDS."""

    def __init__(self, model: Model, infected: bool) -> None:
        super().__init__(model)
        draw = self.random.uniform
        self.x, self.y = draw(0, 25), draw(0, 25)
        self.asks, self.infected, self.known = self.random.random() < 0.5, infected, False
        self.weeks = draw(0, 200) if infected else 0.0
        self.coupling = sum(draw(0, 5) for _ in range(40)) / 20
        self.commitment = sum(draw(0, 50) for _ in range(40)) / 20
        self.partner, self.together = None, 0

    def age(self) -> None:
        self.weeks += self.infected
        self.together += self.partner is not None

    def move(self) -> None:
        if self.partner is None:
            angle = self.random.uniform(0, math.tau)
            self.x, self.y = (self.x + math.sin(angle)) % 25, (self.y + math.cos(angle)) % 25

    def propose(self) -> None:
        if self.partner or not self.asks or self.random.uniform(0, 10) >= self.coupling:
            return
        place = (int(self.x) - 1) % 25, int(self.y)
        others = [person for person in self.model.agents
                  if not person.asks and not person.partner
                  and (int(person.x), int(person.y)) == place]  # fmt: skip
        if others:
            other = self.random.choice(others)
            if self.random.uniform(0, 10) < other.coupling:
                self.partner, other.partner = other, self
                for person in (self, other):
                    person.x, person.y = int(person.x) + 0.5, int(person.y) + 0.5

    def part(self) -> None:
        other = self.partner
        if other and self.together > min(self.commitment, other.commitment):
            self.partner = other.partner = None
            self.together = other.together = 0

    def infect(self) -> None:
        if self.partner and self.infected and not self.known and self.random.random() < 0.5:
            self.partner.infected = True

    def learn(self) -> None:
        if self.weeks > 200 and self.random.random() < 0.05:
            self.known = True


def aids(seed: int, steps: int) -> Mapping[str, float]:
    """AIDS, from its description."""
    model = Model(seed=seed)
    for number in range(300):
        Person(model, infected=number < 300 * 0.025)
    for _ in range(steps):
        for procedure in ("age", "move", "propose", "part", "infect", "learn"):
            model.agents.shuffle_do(procedure)
    people = list(model.agents)
    coupled = [person.partner is not None for person in people]
    return statistics.aids([p.infected for p in people], [p.known for p in people], coupled)
