"""The beam model of range finders: errors of laser ranges.

Thrun, Burgard and Fox, Probabilistic Robotics (2005), section 6.3: a range is drawn from a mixture
of four distributions,

  hit     the true range with a normal error     `Noise.laser_m`
  short   an unmapped object before the hit      exponential with `decay`, truncated at the hit
  max     the beam does not return               `Noise.laser_dropout`
  random  a meaningless range                    uniform, from 0 to the laser's range

This module implements short and random ranges, `Noise` the other two. All probabilities refer to
all beams; the remainder are hits.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from minerva_bus.portable import expm1, log1p
from minerva_services.physics.errors import PhysicsError, finite, positive
from minerva_services.physics.sensors import Distances


@dataclass(frozen=True, slots=True)
class BeamModel:
    """The short and the random component of a laser's ranges.

    Attributes:
        short: probability of a range that is too short.
        decay: λ of the short ranges in 1/m; their mean is 1/λ where the hit is far.
        random: probability of a meaningless range.
        lost: probability that a beam does not return, drawn afterwards by `Noise`.

    Raises:
        PhysicsError: a value that is not finite or not a probability, a sum above 1, or λ <= 0.

    """

    short: float = 0.0
    decay: float = 1.0
    random: float = 0.0
    lost: float = 0.0

    def __post_init__(self) -> None:
        for name in ("short", "random", "lost"):
            value = getattr(self, name)
            finite(f"beam model, {name}", value)
            if not 0 <= value <= 1:
                raise PhysicsError(f"beam model, {name}: expected 0 to 1, found {value!r}")
        positive("beam model, decay in 1/m", self.decay)
        if self.short + self.random + self.lost > 1 + 1e-9:
            raise PhysicsError(
                f"beam model: {self.short:g} short, {self.random:g} random and {self.lost:g} lost"
                " beams are more than all; expected 1 at most"
            )

    def __bool__(self) -> bool:
        return bool(self.short or self.random)

    def sample(
        self,
        true: Distances,
        measured: Distances,
        range_max: float,
        rng: np.random.Generator,
    ) -> Distances:
        """Replace a random subset of the ranges by short and random ones.

        Args:
            true: (beams,) true distances in metres; `range_max` for no hit.
            measured: (beams,) the same with the error of hits.
            range_max: range in metres.
            rng: consumes two values per beam.

        Returns:
            (beams,) in metres; short and random ranges are below `range_max`.

        """
        which, where = rng.random((2, *true.shape))
        back = 1 - self.lost  # `Noise` removes lost beams afterwards
        short = which * back < self.short
        random = ~short & (which * back < self.short + self.random)
        # Inverse of the exponential distribution truncated at the hit.
        cut = -log1p(where * expm1(-self.decay * true)) / self.decay
        return np.where(short, cut, np.where(random, where * range_max, measured))
