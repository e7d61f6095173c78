"""What a region shows another one for services with a halo."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

from minerva_bus.regions.merging import Units

Figures: TypeAlias = Mapping[str, Units]
"""Figures with their places, by visual event type; those outside of agents by `scenery_of` it."""


@dataclass(frozen=True, slots=True)
class HaloPart:
    """Figures of one frame.

    `kept` is what services have saved of these agents, by the name of the service; it is only
    shown with `Halo.kept`. `halted` are the agents whose actions devices must not execute.
    """

    figures: Figures = field(default_factory=dict[str, Units])
    kept: Mapping[str, str] = field(default_factory=dict[str, str])
    halted: tuple[str, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.figures)


NO_HALO = HaloPart()
