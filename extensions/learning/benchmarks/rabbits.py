"""The rabbits of examples/survival in Mesa, wrapped by hand as an environment."""

# Mesa's classes have attributes of the model, which its annotations do not know.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import math
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from mesa import Agent, Model

SIZE, SPEED, HUNGER, NOSE = 20.0, 0.25, 0.03, 0.6


def scent(x: float, y: float, frame: int) -> float:
    turn = 2 * math.pi * frame / 400
    far = math.hypot(x - 10 - 6 * math.cos(turn), y - 10 - 6 * math.sin(turn))
    return 1 / (1 + (far / 3) ** 2)


class Rabbit(Agent):
    def __init__(self, model: Model, number: int, count: int) -> None:
        super().__init__(model)
        radius, turn = math.sqrt((number + 0.5) / count), 2.4 * number
        self.x = 10 + 9 * radius * math.cos(turn)
        self.y = 10 + 9 * radius * math.sin(turn)
        self.heading, self.energy = 97.0 * number % 360, 2.0
        self.left = self.right = self.turn = 0.0

    def ahead(self, way: float, angle: float) -> tuple[float, float]:
        turn = math.radians(self.heading + angle)
        return self.x + way * math.cos(turn), self.y + way * math.sin(turn)

    def step(self) -> None:
        self.heading += self.turn
        x, y = self.ahead(SPEED, 0)
        self.x, self.y = min(max(x, 0.0), SIZE), min(max(y, 0.0), SIZE)
        frame = self.model.frame
        self.energy = min(4.0, self.energy + 0.1 * scent(self.x, self.y, frame) - HUNGER)
        if self.energy <= 0:
            self.remove()
            return
        noise = 1 + 0.1 * self.model.rng.normal()
        self.left = noise * scent(*self.ahead(NOSE, 60), frame)
        self.right = noise * scent(*self.ahead(NOSE, -60), frame)


class Rabbits(Model):
    def __init__(self, count: int, seed: int | None) -> None:
        super().__init__(seed=seed)
        self.frame = 0
        self.rabbits = [Rabbit(self, number, count) for number in range(count)]

    def step(self) -> None:
        self.agents.do("step")
        self.frame += 1


class MesaEnv(gymnasium.Env[Any, Any]):
    """All rabbits of a model: an action and an observation is a row for each."""

    def __init__(self, count: int, frames: int) -> None:
        self.observation_space = spaces.Box(-np.inf, np.inf, (count, 3), np.float64)
        self.action_space = spaces.Box(-30, 30, (count, 1), np.float64)
        self._count, self._frames = count, frames

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        super().reset(seed=seed)
        self.model = Rabbits(self._count, int(self.np_random.integers(1 << 31)))
        return self._seen(), {}

    def step(self, action: Any):
        for rabbit, (turn,) in zip(self.model.rabbits, action, strict=True):
            rabbit.turn = float(turn)
        before = len(self.model.agents)
        self.model.step()
        left = len(self.model.agents)
        return self._seen(), left / before, left == 0, self.model.frame >= self._frames, {}

    def _seen(self) -> Any:
        return np.array([[r.left, r.right, r.energy] for r in self.model.rabbits])
