"""Wealth exchange without space: an agent with coins gives one to a random agent per step.

A coin arrives in the next step. The distribution approaches Boltzmann's exponential distribution.
The total of wealth and coins in transit is constant and equals the number of agents.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from benchmarks.models.events import Clock, eStep
from minerva_bus import (
    Agent,
    BatchContext,
    Event,
    EventBatch,
    EventType,
    Scene,
    Vocabulary,
    on,
)
from minerva_bus.grammar.ids import Ids
from minerva_bus.world.services import Service

NAME = "wealth"
order = ("eGive", "eStep")

eGive = EventType("eGive")


class Person(Agent, symbol="APerson"):
    """An agent with some coins."""

    wealth: int = 1

    @on("eStep", population=True)
    def step(self, step: Event, moment: BatchContext) -> None:
        rich = self.wealth > 0
        somebody = Ids.numbered("w", moment.chance.integers(step.count))
        moment.emit(eGive(receivers=somebody), where=rich)
        self.wealth -= rich

    @on("eGive", together=True)
    def take(self, given: EventBatch, moment: BatchContext) -> None:
        self.wealth += np.bincount(given.row, minlength=len(self))


kinds: list[type[Agent]] = [Person]
vocabulary = Vocabulary.of(eStep, eGive, Person)


def scene(agents: int, seed: int) -> Scene:
    """All agents have one coin."""
    return Person.many("w", agents)


def services(agents: int) -> dict[str, Callable[[], Service]]:
    """A clock."""
    return {"clock": partial(Clock, agents)}


def updates_per_frame(agents: int) -> int:
    """All agents act in every frame."""
    return agents
