"""The models of `python -m benchmarks.populations`, modules with a common interface."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Final, Protocol, cast

from minerva_bus import Agent, Scene, Vocabulary
from minerva_bus.world.services import Service

MODELS: Final = ("flock", "schelling", "wolf_sheep", "wealth", "plain")


class Model(Protocol):
    """Interface of the modules in this package.

    A module may also have `CYCLE`, the number of frames per step of the model (default 1), and
    `COUNTED`, the kinds whose living agents are the updates of a step if their number varies.
    """

    NAME: str
    vocabulary: Vocabulary
    kinds: list[type[Agent]]
    order: tuple[str, ...]

    def scene(self, agents: int, seed: int) -> Scene:
        """The initial string of the model."""
        ...

    def services(self, agents: int) -> dict[str, Callable[[], Service]]:
        """Factories of its services, by name."""
        ...

    def updates_per_frame(self, agents: int) -> int:
        """Number of agents that act in a frame."""
        ...


def load(name: str) -> Model:
    """The model with this name."""
    return cast("Model", import_module(f"benchmarks.models.{name}"))


def cycle(model: Model) -> int:
    """Number of frames per step of a model."""
    return getattr(model, "CYCLE", 1)


def counted(model: Model) -> tuple[str, ...]:
    """Kinds whose living agents are the updates of a step; empty if the number is fixed."""
    return getattr(model, "COUNTED", ())
