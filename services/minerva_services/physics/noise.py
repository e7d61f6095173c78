"""Normal noise and dropouts of simulated sensors and motors, from a given random generator.

A kind of noise that is zero draws nothing. Otherwise the number of values drawn does not depend on
the data, so runs that differ in a wall stay comparable.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from minerva_bus.portable import normal, normals
from minerva_bus.world.readings import Sighting
from minerva_services.physics.errors import PhysicsError, finite
from minerva_services.physics.sensors import Distances


@dataclass(frozen=True, slots=True)
class Noise:
    """Standard deviations of unbiased normal noise, and a dropout probability.

    Attributes:
        laser_m: laser distance in metres.
        laser_dropout: probability that a beam does not return.
        drive: driven distance, relative.
        turn_deg: turn in degrees; applies to commanded turns only.
        camera_m: distance of a marker in metres.
        camera_deg: bearing of a marker in degrees.

    Raises:
        PhysicsError: a value is negative or not finite, or the probability is above 1.

    """

    laser_m: float = 0.0
    laser_dropout: float = 0.0
    drive: float = 0.0
    turn_deg: float = 0.0
    camera_m: float = 0.0
    camera_deg: float = 0.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            finite(f"noise, {field.name}", value)
            if value < 0:
                raise PhysicsError(f"noise, {field.name}: expected 0 or more, found {value!r}")
        if self.laser_dropout > 1:
            raise PhysicsError(f"noise, laser_dropout: expected 0 to 1, found {self.laser_dropout}")

    @property
    def of_motors(self) -> bool:
        """Whether `drive_errors` draws."""
        return bool(self.drive or self.turn_deg)

    @property
    def of_laser(self) -> bool:
        """Whether `hits` or `returns` draw."""
        return bool(self.laser_m or self.laser_dropout)

    @property
    def of_camera(self) -> bool:
        """Whether `sightings` draws."""
        return bool(self.camera_m or self.camera_deg)

    def scan(self, distances: Distances, range_max: float, rng: np.random.Generator) -> Distances:
        """Laser distances as measured.

        Args:
            distances: (beams,) in metres; `range_max` means no hit, and stays.
            range_max: in metres; reading of a lost beam.
            rng: draws `beams` values for each of the two kinds of laser noise.

        Returns:
            (beams,) in metres, from 0 to `range_max`.

        """
        return self.returns(self.hits(distances, range_max, rng), range_max, rng)

    def hits(self, distances: Distances, range_max: float, rng: np.random.Generator) -> Distances:
        """Distances with the normal error of hits; arguments as in `scan`."""
        if self.laser_m:
            # Not by the generator's own `normal`, which ends in the C library's log1p: its last
            # bits depend on the machine. The same holds for the other draws of this class.
            noisy = distances + normals(rng, len(distances), self.laser_m)
            noisy = np.clip(noisy, 0.0, range_max)
            distances = np.where(distances < range_max, noisy, distances)
        return distances

    def returns(
        self, distances: Distances, range_max: float, rng: np.random.Generator
    ) -> Distances:
        """Distances with lost beams set to `range_max`; arguments as in `scan`."""
        if self.laser_dropout:
            lost = rng.random(distances.shape) < self.laser_dropout
            distances = np.where(lost, range_max, distances)
        return distances

    def drive_errors(
        self, turn_degrees: float, forward_m: float, rng: np.random.Generator
    ) -> tuple[float, float]:
        """A command as the wheels execute it: turn in degrees, distance in metres."""
        if self.turn_deg:
            # Drawn for a command of 0, too, so that the number of values does not depend on the
            # command.
            error = normal(rng, self.turn_deg)
            turn_degrees += error if turn_degrees else 0.0
        if self.drive:
            forward_m *= 1 + normal(rng, self.drive)
        return turn_degrees, forward_m

    def sightings(
        self, sightings: Sequence[Sighting], rng: np.random.Generator
    ) -> tuple[Sighting, ...]:
        """Sightings as measured; distances are clamped at 0 m, bearings are not wrapped."""
        if not self.of_camera:
            return tuple(sightings)
        return tuple(self._measured(sighting, rng) for sighting in sightings)

    def _measured(self, sighting: Sighting, rng: np.random.Generator) -> Sighting:
        distance, angle = sighting.distance, sighting.angle
        if self.camera_m:
            distance = max(0.0, distance + normal(rng, self.camera_m))
        if self.camera_deg:
            angle += normal(rng, self.camera_deg)
        return Sighting(sighting.marker, distance, angle)
