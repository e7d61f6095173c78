"""Normal noise and dropouts of simulated sensors and motors, from a given random generator.

A kind of noise that is zero draws nothing. Otherwise the number of values drawn does not depend on
the data, so runs that differ in a wall stay comparable.

Further errors of motors, range finders and marker cameras follow published models: sections and
tables are those of Thrun, Burgard and Fox, Probabilistic Robotics (2005). Streams are keyed by
(seed, physics/robot/device, frame), so one robot's laser draws the same values regardless of other
robots and other errors, and whichever process draws them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import fields, replace

import numpy as np

from minerva_bus.portable import expm1, log1p, normal, normals
from minerva_bus.values import fast_dataclass
from minerva_bus.world.context import stream
from minerva_bus.world.readings import Sighting
from minerva_bus.world.services import Tick
from minerva_services.physics.errors import PhysicsError, finite, positive
from minerva_services.physics.sensors import Distances


@fast_dataclass
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


@fast_dataclass
class SightingModel:
    """Missed and confused markers: two probabilities per visible marker.

    Like the landmark models of section 6.6 with a detection probability and a signature that may be
    wrong.

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
        # Three values per sighting, used or not, so that no outcome shifts the values of the next
        # one.
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


@fast_dataclass
class DriveStep:
    """Turn in degrees, drive in metres, turn again in degrees."""

    turn_deg: float
    forward_m: float
    after_deg: float = 0.0


@fast_dataclass
class MotionModel:
    """The odometry motion model, section 5.4, table 5.6 (sample_motion_model).

    A step is a turn, a translation and a second turn, each with a normal error whose variance grows
    with the squares of the commanded turn (radians) and translation (metres):

      first turn   α1 turn² + α2 way²
      way          α3 way² + α4 turn²
      second turn  α2 way²               its command is 0 in this world

    Variances apply per step. Errors of successive steps partly cancel: over n equal steps the
    standard deviation grows with √n, so shorter frames yield a more accurate robot. All α 0 means
    no error.

    Attributes:
        alpha1: turn error from turning.
        alpha2: turn error from driving, in rad²/m².
        alpha3: distance error from driving.
        alpha4: distance error from turning, in m²/rad².

    Raises:
        PhysicsError: a value is negative or not finite.

    """

    alpha1: float = 0.0
    alpha2: float = 0.0
    alpha3: float = 0.0
    alpha4: float = 0.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            finite(f"motion model, {field.name}", value)
            if value < 0:
                raise PhysicsError(
                    f"motion model, {field.name}: expected 0 or more, found {value!r}"
                )

    def __bool__(self) -> bool:
        return any(getattr(self, field.name) for field in fields(self))

    def sample(self, turn_deg: float, forward_m: float, rng: np.random.Generator) -> DriveStep:
        """A command as actually driven; a zero command has no error.

        Args:
            turn_deg: commanded turn in degrees.
            forward_m: commanded distance in metres.
            rng: consumes three normal values.

        """
        turn = math.radians(turn_deg)
        # As in `Noise`, portable numbers instead of the generator's own.
        first, way, second = normals(rng, 3).tolist()
        # IEEE 754 defines the square root exactly, so `math.sqrt` gives the same bits on every
        # machine.
        turning = math.sqrt(self.alpha1 * turn * turn + self.alpha2 * forward_m * forward_m)
        driving = math.sqrt(self.alpha3 * forward_m * forward_m + self.alpha4 * turn * turn)
        swerving = math.sqrt(self.alpha2) * abs(forward_m)
        return DriveStep(
            turn_deg + math.degrees(turning * first),
            forward_m + driving * way,
            math.degrees(swerving * second),
        )


@fast_dataclass
class BeamModel:
    """The short and the random component of the beam model of range finders, section 6.3.

    A range is drawn from a mixture of four distributions:

      hit     the true range with a normal error     `Noise.laser_m`
      short   an unmapped object before the hit      exponential with `decay`, truncated at the hit
      max     the beam does not return               `Noise.laser_dropout`
      random  a meaningless range                    uniform, from 0 to the laser's range

    This class implements short and random ranges, `Noise` the other two. All probabilities refer to
    all beams; the remainder are hits.

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
        # Probabilities that add up to 1 may exceed it by rounding.
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
        # A reading survives the later dropout with probability `back`. Scaling the draw by it keeps
        # `short` and `random` probabilities of all beams, without a division by 0 where all are
        # lost.
        back = 1 - self.lost  # `Noise` removes lost beams afterwards
        short = which * back < self.short
        random = ~short & (which * back < self.short + self.random)
        # Inverse of the exponential distribution truncated at the hit.
        cut = -log1p(where * expm1(-self.decay * true)) / self.decay
        return np.where(short, cut, np.where(random, where * range_max, measured))


@fast_dataclass
class ErrorModels:
    """All error models of a world's robots; a model whose parameters are 0 draws nothing."""

    noise: Noise
    motion: MotionModel
    beams: BeamModel
    sightings: SightingModel

    def drive(self, robot: str, turn_deg: float, forward_m: float, tick: Tick) -> DriveStep:
        """The turn and distance actually driven for a command (degrees, metres)."""
        turn, forward = turn_deg, forward_m
        if self.noise.of_motors:
            turn, forward = self.noise.drive_errors(turn, forward, _own(tick, robot, "wheels"))
        if not self.motion:
            return DriveStep(turn, forward)
        return self.motion.sample(turn, forward, _own(tick, robot, "motors"))

    def scan(self, robot: str, true: Distances, range_max: float, tick: Tick) -> Distances:
        """Measured distances for true ones, (beams,) in metres."""
        beams = _own(tick, robot, "beams") if self.noise.of_laser else None
        measured = true if beams is None else self.noise.hits(true, range_max, beams)
        if self.beams:
            own = _own(tick, robot, "laser")
            measured = self.beams.sample(true, measured, range_max, own)
        return measured if beams is None else self.noise.returns(measured, range_max, beams)

    def recognised(
        self, robot: str, seen: Sequence[Sighting], names: Sequence[str], tick: Tick
    ) -> tuple[Sighting, ...]:
        """Recognised markers; `names` are those of all markers, sorted."""
        if self.sightings:
            seen = self.sightings.sample(seen, names, _own(tick, robot, "camera"))
        if not self.noise.of_camera:
            return tuple(seen)
        return self.noise.sightings(seen, _own(tick, robot, "image"))


def _own(tick: Tick, robot: str, device: str) -> np.random.Generator:
    return stream(tick.frame.seed, f"{tick.who}/{robot}/{device}", tick.number)
