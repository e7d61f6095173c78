"""Motors and sensors with errors, each drawn from its own random stream.

The models' streams are keyed by (seed, physics/robot/device, frame), so one robot's laser draws the
same values regardless of other robots and other errors. `Noise` draws from the tick's stream.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from minerva_bus.world.readings import Sighting
from minerva_bus.world.rng import stream
from minerva_bus.world.services import Tick
from minerva_services.physics.beam_model import BeamModel
from minerva_services.physics.motion_model import DriveStep, MotionModel
from minerva_services.physics.noise import Noise
from minerva_services.physics.sensors import Distances
from minerva_services.physics.sighting_model import SightingModel


@dataclass(frozen=True, slots=True)
class ErrorModels:
    """All error models of a world's robots; a model whose parameters are 0 draws nothing."""

    noise: Noise
    motion: MotionModel
    beams: BeamModel
    sightings: SightingModel

    def drive(self, robot: str, turn_deg: float, forward_m: float, tick: Tick) -> DriveStep:
        """The turn and distance actually driven for a command (degrees, metres)."""
        turn, forward = self.noise.drive_errors(turn_deg, forward_m, tick.random)
        if not self.motion:
            return DriveStep(turn, forward)
        return self.motion.sample(turn, forward, _own(tick, robot, "motors"))

    def scan(self, robot: str, true: Distances, range_max: float, tick: Tick) -> Distances:
        """Measured distances for true ones, (beams,) in metres."""
        measured = self.noise.hits(true, range_max, tick.random)
        if self.beams:
            own = _own(tick, robot, "laser")
            measured = self.beams.sample(true, measured, range_max, own)
        return self.noise.returns(measured, range_max, tick.random)

    def recognised(
        self, robot: str, seen: Sequence[Sighting], names: Sequence[str], tick: Tick
    ) -> tuple[Sighting, ...]:
        """Recognised markers; `names` are those of all markers, sorted."""
        if self.sightings:
            seen = self.sightings.sample(seen, names, _own(tick, robot, "camera"))
        return self.noise.sightings(seen, tick.random)


def _own(tick: Tick, robot: str, device: str) -> np.random.Generator:
    return stream(tick.frame.seed, f"{tick.who}/{robot}/{device}", tick.number)
