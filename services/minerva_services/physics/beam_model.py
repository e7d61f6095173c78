"""What a laser's beams measure beside the truth: the beam model of range finders.

Thrun, Burgard and Fox, Probabilistic Robotics (2005), section 6.3: a range is one of four mixed,

    hit     the true one, with a normal error       `Noise.laser_m`
    short   something that no map has stood before  exponential with `decay`, cut off at the hit
    max     the beam does not come back             `Noise.laser_dropout`
    random  anything                                uniform, from 0 to the laser's range

Here are the short and the random part; `Noise` has the two others. All four probabilities are of
all beams: the hits are what is left.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from minerva_bus.portable import expm1, log1p
from minerva_services.physics.errors import PhysicsError, finite, positive
from minerva_services.physics.sensors import Distances


@dataclass(frozen=True, slots=True)
class BeamModel:
    """The short and the random part of a laser's ranges.

    Attributes:
        short: probability of a range that is too short.
        decay: λ of the short ranges in 1/m; their mean is 1/λ where the hit is far.
        random: probability of a range that means nothing.
        lost: probability of a beam that does not come back, which `Noise` draws afterwards.

    Raises:
        PhysicsError: a value that is not finite, no probability, together more than 1, or λ not
            above 0.

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
        """Ranges with some that are short or random.

        Args:
            true: (beams,) distances in metres to what is there; `range_max` for nothing.
            measured: (beams,) what is measured of them with the hits' own error.
            range_max: in metres.
            rng: two values for each beam are drawn from it.

        Returns:
            (beams,) in metres, below `range_max` where they are short or random.

        """
        which, where = rng.random((2, *true.shape))
        back = 1 - self.lost  # of these `Noise` takes some away again
        short = which * back < self.short
        random = ~short & (which * back < self.short + self.random)
        # The exponential distribution cut off at the hit, turned round.
        cut = -log1p(where * expm1(-self.decay * true)) / self.decay
        return np.where(short, cut, np.where(random, where * range_max, measured))
