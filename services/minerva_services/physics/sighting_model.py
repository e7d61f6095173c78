"""Errors of marker recognition: missed and confused markers.

A miss rate and a confusion of identities, like the landmark models of Thrun, Burgard and Fox,
Probabilistic Robotics (2005), section 6.6, with a detection probability and a signature that may be
wrong.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from minerva_bus.world.readings import Sighting
from minerva_services.physics.errors import PhysicsError, finite


@dataclass(frozen=True, slots=True)
class SightingModel:
    """Two probabilities per visible marker.

    Attributes:
        miss: it is not recognised.
        mistake: it is recognised as another marker of the world.

    Raises:
        PhysicsError: a value is not a probability.

    """

    miss: float = 0.0
    mistake: float = 0.0

    def __post_init__(self) -> None:
        for name, value in (("miss", self.miss), ("mistake", self.mistake)):
            finite(f"sighting model, {name}", value)
            if not 0 <= value <= 1:
                raise PhysicsError(f"sighting model, {name}: expected 0 to 1, found {value!r}")

    def __bool__(self) -> bool:
        return bool(self.miss or self.mistake)

    def sample(
        self, sightings: Sequence[Sighting], names: Sequence[str], rng: np.random.Generator
    ) -> tuple[Sighting, ...]:
        """The recognised subset of visible markers.

        Args:
            sightings: visible markers.
            names: names of all markers, sorted; a single marker cannot be confused.
            rng: consumes three values per sighting.

        """
        draws = rng.random((len(sightings), 3)).tolist()
        return tuple(
            self._taken(seen, names, mistake, other)
            for seen, (miss, mistake, other) in zip(sightings, draws, strict=True)
            if miss >= self.miss
        )

    def _taken(
        self, seen: Sighting, names: Sequence[str], mistake: float, other: float
    ) -> Sighting:
        others = [name for name in names if name != seen.marker]
        if mistake >= self.mistake or not others:
            return seen
        return replace(seen, marker=others[int(other * len(others))])
