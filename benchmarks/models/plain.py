"""Agents without population methods, in plain Python: they walk between two walls."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from benchmarks.models.events import Clock, eStep
from minerva_bus import Agent, Context, Event, Scene, Vocabulary, on
from minerva_bus.world.services import Service

NAME = "plain"
order = ("eStep",)
WIDTH = 100.0


class Walker(Agent, symbol="AWalker"):
    """Walks and turns at the walls."""

    x: float = 0.0
    speed: float = 1.0

    @on("eStep")
    def step(self, step: Event, moment: Context) -> None:
        self.x += self.speed
        if not 0.0 <= self.x <= WIDTH:
            self.speed = -self.speed


kinds: list[type[Agent]] = [Walker]
vocabulary = Vocabulary.of(eStep, Walker)


def scene(agents: int, seed: int) -> Scene:
    """Walkers with random positions and speeds."""
    chance = np.random.default_rng(seed)
    places, speeds = chance.uniform(0.0, WIDTH, agents), chance.uniform(-2.0, 2.0, agents)
    return Walker.many("w", agents, x=places, speed=speeds)


def services(agents: int) -> dict[str, Callable[[], Service]]:
    """A clock."""
    return {"clock": partial(Clock, agents)}


def updates_per_frame(agents: int) -> int:
    """All walkers act in every frame."""
    return agents
