"""The models of `python -m benchmarks.populations`, each a module of one form."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Final, Protocol, cast

from minerva_bus import Agent, Scene, Vocabulary
from minerva_bus.world.services import Service

MODELS: Final = ("flock", "schelling", "wolf_sheep", "wealth", "plain")


class Model(Protocol):
    """What a module of this package has.

    It may also have `CYCLE`, how many frames one step of the model takes (1 where it has not), and
    `COUNTED`, the kinds whose living agents are the updates of a step, where their number varies.
    """

    NAME: str
    vocabulary: Vocabulary
    kinds: list[type[Agent]]
    order: tuple[str, ...]

    def scene(self, agents: int, seed: int) -> Scene:
        """The string that the model begins with."""
        ...

    def services(self, agents: int) -> dict[str, Callable[[], Service]]:
        """What makes its services, by name."""
        ...

    def updates_per_frame(self, agents: int) -> int:
        """How many agents act in a frame."""
        ...

    def statistics(self, scene: Scene) -> dict[str, float]:
        """What the string looks like from afar."""
        ...


def load(name: str) -> Model:
    """The model of this name."""
    return cast("Model", import_module(f"benchmarks.models.{name}"))


def cycle(model: Model) -> int:
    """How many frames one step of a model takes."""
    return getattr(model, "CYCLE", 1)


def counted(model: Model) -> tuple[str, ...]:
    """The kinds whose living agents are the updates of a step; none where that is fixed."""
    return getattr(model, "COUNTED", ())
