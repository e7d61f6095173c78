"""Markers that a camera misses, and markers that it takes for others.

A detector's miss rate and its confusion of identities, as in the landmark models of Thrun, Burgard
and Fox, Probabilistic Robotics (2005), section 6.6, with a detection probability and a signature
that may be wrong.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from minerva_services.physics.errors import PhysicsError, finite
from minerva_services.physics.sensors import Sighting


@dataclass(frozen=True, slots=True)
class SightingModel:
    """Two probabilities for each marker in view.

    Attributes:
        miss: that it is not recognised.
        mistake: that one which is recognised is taken for another of the world's.

    Raises:
        PhysicsError: a value that is no probability.

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
        """What is recognised of some markers in view.

        Args:
            sightings: those in view.
            names: of all markers of the world, sorted; one alone cannot be mistaken.
            rng: three values for each sighting are drawn from it.

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
