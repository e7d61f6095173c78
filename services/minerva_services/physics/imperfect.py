"""Motors and sensors with errors, each drawn from a stream of its own.

The models' streams are keyed by (seed, physics/robot/device, frame): so what one robot's laser
draws does not depend on who else is there, nor on which other errors there are. `Noise` draws from
the tick's own stream.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from minerva_bus.world.rng import stream
from minerva_bus.world.services import Tick
from minerva_services.physics.beam_model import BeamModel
from minerva_services.physics.motion_model import MotionModel, Step
from minerva_services.physics.noise import Noise
from minerva_services.physics.sensors import Distances, Sighting
from minerva_services.physics.sighting_model import SightingModel


@dataclass(frozen=True, slots=True)
class Imperfection:
    """All errors of a world's robots; none of them draws anything that is all 0."""

    noise: Noise
    motion: MotionModel
    beams: BeamModel
    sightings: SightingModel

    def on_drive(self, robot: str, turn_deg: float, forward_m: float, tick: Tick) -> Step:
        """A command in degrees and metres as it is carried out."""
        turn, forward = self.noise.on_drive(turn_deg, forward_m, tick.random)
        if not self.motion:
            return Step(turn, forward)
        return self.motion.sample(turn, forward, _own(tick, robot, "motors"))

    def on_scan(self, robot: str, true: Distances, range_max: float, tick: Tick) -> Distances:
        """A laser's distances in metres, (beams,), as measured."""
        measured = self.noise.on_hits(true, range_max, tick.random)
        if self.beams:
            own = _own(tick, robot, "laser")
            measured = self.beams.sample(true, measured, range_max, own)
        return self.noise.on_returns(measured, range_max, tick.random)

    def on_sightings(
        self, robot: str, seen: Sequence[Sighting], names: Sequence[str], tick: Tick
    ) -> tuple[Sighting, ...]:
        """Markers as recognised; `names` are those of all markers, sorted."""
        if self.sightings:
            seen = self.sightings.sample(seen, names, _own(tick, robot, "camera"))
        return self.noise.on_sightings(seen, tick.random)


def _own(tick: Tick, robot: str, device: str) -> np.random.Generator:
    return stream(tick.frame.seed, f"{tick.who}/{robot}/{device}", tick.number)
