"""The physics member: robots drive in it, and it publishes their sensor readings.

Table 4's gLaser and gCamera turn the readings into events; a real laser and camera publish the
same.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from minerva_bus.grammar.events import Event
from minerva_bus.semantics.geometry import interpret
from minerva_bus.values import fast_dataclass
from minerva_bus.world.readings import Scan, Sightings
from minerva_bus.world.services import Device, Generator, Tick, View, WorldInfo
from minerva_services.options import takes_options
from minerva_services.physics.agent_lines import AGENTS, agent_lines
from minerva_services.physics.arena import ArenaState
from minerva_services.physics.body import DriveCommand, DriveOutcome
from minerva_services.physics.collision_events import Collision, CollisionEvents
from minerva_services.physics.errors import PhysicsError, positive
from minerva_services.physics.geometry import PhysicalGeometry
from minerva_services.physics.kept import KeptBody, kept_bodies
from minerva_services.physics.noise import BeamModel, ErrorModels, MotionModel, Noise, SightingModel


@fast_dataclass
class PhysicsOptions:
    """Options of robots' sensors, and of the errors of sensors and motors.

    Args:
        beams: number of beams of each robot's laser.
        fov: the laser's field of view in degrees, centred on the heading.
        range_max: the laser's range in metres.
        camera_fov: the camera's field of view in degrees, centred on the heading.
        camera_range: the camera's range in metres.
        laser_noise: standard deviation of the laser's distances in metres.
        laser_dropout: probability, 0 to 1, that a beam does not return.
        drive_noise: standard deviation of driven distances, relative.
        turn_noise: standard deviation of turns in degrees.
        camera_noise: standard deviation of the camera's distances in metres.
        camera_angle_noise: standard deviation of the camera's angles in degrees.
        alpha1: α1 of `MotionModel`: turn error from turning, as a variance.
        alpha2: turn error from driving, rad²/m².
        alpha3: distance error from driving.
        alpha4: distance error from turning, m²/rad².
        laser_short: probability of a beam that ends before its obstacle, see `BeamModel`.
        laser_decay: λ of these short ranges in 1/m.
        laser_random: probability of a meaningless range.
        camera_miss: probability that a visible marker is not recognised.
        camera_mistake: probability that a recognised marker is taken for another.

    """

    beams: int = 90
    fov: float = 360.0
    range_max: float = 8.0
    camera_fov: float = 70.0
    camera_range: float = 5.0
    laser_noise: float = 0.0
    laser_dropout: float = 0.0
    drive_noise: float = 0.0
    turn_noise: float = 0.0
    camera_noise: float = 0.0
    camera_angle_noise: float = 0.0
    alpha1: float = 0.0
    alpha2: float = 0.0
    alpha3: float = 0.0
    alpha4: float = 0.0
    laser_short: float = 0.0
    laser_decay: float = 1.0
    laser_random: float = 0.0
    camera_miss: float = 0.0
    camera_mistake: float = 0.0


class Physics(Device, Generator, draws=("eRepresent",), coupled=True, events=("eCollision",)):
    """Executes the commands of each view in the following tick, and then measures.

    `eCollision(shortfall)` notifies a robot that it was stopped, with the commanded distance that
    it did not drive; also by what and where, if the world's type declares such data: see
    `minerva_services.physics.collision_events`. The options are those of `PhysicsOptions`.
    """

    publishes = ("scan", "sightings")
    by_agent = True

    @takes_options(PhysicsOptions)
    def __init__(self, **options: Any) -> None:
        given = PhysicsOptions(**options)
        self._beams = given.beams
        self._first, self._step = _directions(given.beams, given.fov)
        self._range_max = _positive("range_max", given.range_max)
        self._camera_fov = _positive("camera_fov", given.camera_fov)
        self._camera_range = _positive("camera_range", given.camera_range)
        self._errors = ErrorModels(
            Noise(
                given.laser_noise,
                given.laser_dropout,
                given.drive_noise,
                given.turn_noise,
                given.camera_noise,
                given.camera_angle_noise,
            ),
            MotionModel(given.alpha1, given.alpha2, given.alpha3, given.alpha4),
            BeamModel(
                given.laser_short, given.laser_decay, given.laser_random, given.laser_dropout
            ),
            SightingModel(given.camera_miss, given.camera_mistake),
        )
        self._begin()

    def _begin(self, serves: Callable[[str], bool] = lambda _: True) -> None:
        self._serves = serves
        self._stage = ArenaState(serves)
        self._commands: dict[str, DriveCommand] = {}
        self._shown: int | None = None
        self._seen: tuple[str, ...] = ()
        self._carried_out: dict[str, int] = {}
        self._stopped: dict[str, str] = {}

    def check(self, world: WorldInfo) -> None:
        self._collision_events = CollisionEvents("physics", world, "eCollision", "shortfall")

    def joined(self, world: WorldInfo) -> None:
        self.check(world)
        self._begin(world.serves)

    def show(self, view: View) -> None:
        """φ of the view: set bodies, walls and markers now; commands run in the next tick.

        An agent whose step does not count gets no command: its body stays with it.

        Raises:
            PhysicsError: something cannot stand where the view shows it.

        """
        seen = PhysicalGeometry()
        interpret(view.scene, seen)
        self._stage.set(seen)
        self._shown = view.frame
        self._seen = tuple(seen.robots)
        # A successor receives the last view again, which its predecessor may have executed.
        self._commands = {
            name: robot.command
            for name, robot in seen.robots.items()
            if name not in view.halted and view.frame > self._carried_out.get(name, -1)
        }

    def generate(self, tick: Tick) -> Iterable[Event]:
        """Drive, then measure; nothing before the first view."""
        if self._shown is None:
            return ()
        # All bodies, because they stop each other: rays take most of the time.
        outcomes = self._drive(tick)
        # In the order of the string, which is that of the events.
        own = [name for name in self._seen if self._serves(name)]
        for name in own:
            tick.publish("scan", self._scan(name, tick))
        for name in own:
            tick.publish("sightings", self._sightings(name, tick))
        commands, self._commands = self._commands, {}
        stopped, self._stopped = self._stopped, {}
        self._carried_out = dict.fromkeys(self._seen, self._shown)
        return [
            self._collision(commands[name], outcomes[name], stopped)
            for name in self._seen
            if name in outcomes and outcomes[name].collided
        ]

    def save(self) -> Mapping[str, Any]:
        """State that views do not contain: poses of bodies, and the last executed view."""
        stage = self._stage
        lines = {name: self._kept(name).text for name in stage.arena.bodies}
        return {
            AGENTS: agent_lines(lines),
            "retired_um": stage.retired_um,
            "retired_collisions": stage.retired_collisions,
        }

    def _kept(self, name: str) -> KeptBody:
        body = self._stage.arena.body(name)
        return KeptBody(body, self._carried_out.get(name, -1), self._stopped.get(name))

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Continue from a saved state; walls and markers come with the next view.

        Raises:
            PhysicsError: the value was not produced by `save`.

        """
        kept = kept_bodies(saved)
        try:
            retired = int(saved["retired_um"]), int(saved["retired_collisions"])
        except (KeyError, TypeError, ValueError) as error:
            raise PhysicsError(f"not the saved state of a physics world: {error!r}") from error
        stage = self._stage
        stage.restore({name: each.body for name, each in kept.items()})
        stage.retired_um, stage.retired_collisions = retired
        self._carried_out = {name: each.carried_out for name, each in kept.items()}
        stopped = {name: each.stopped_by for name, each in kept.items()}
        self._stopped = {name: by for name, by in stopped.items() if by is not None}

    def report(self) -> Mapping[str, bool | int | float | str]:
        """Distance driven and stopped moves, over all robots."""
        total = self._stage.total()
        return {"distance_driven": round(total.driven_m, 6), "collisions": total.collisions}

    def _drive(self, tick: Tick) -> Mapping[str, DriveOutcome]:
        """Drive all bodies, which may stop each other; outcomes by name."""
        arena, after = self._stage.arena, dict[str, float]()
        for name, command in sorted(self._commands.items()):
            step = self._errors.drive(name, command.turn_deg, command.forward_m, tick)
            arena.drive(name, step.turn_deg, step.forward_m)
            after[name] = step.after_deg
        outcomes = arena.step(tick.dt)
        # The second turn of the motion model follows the move, so it cannot be part of the command.
        for name, turn in after.items():
            arena.turn(name, turn)
        return {outcome.name: outcome for outcome in outcomes}

    def _collision(
        self, command: DriveCommand, outcome: DriveOutcome, before: Mapping[str, str]
    ) -> Event:
        """The event for a stopped robot; `before` says what stopped whom in the previous tick."""
        touched = outcome.contact
        assert touched is not None
        name = outcome.name
        self._stopped[name] = touched.other
        collision = Collision(
            _shortfall(command, outcome),
            touched.other,
            "PRobot" if touched.other else "PMap",
            touched.x,
            touched.y,
            touched.nx,
            touched.ny,
            begins=before.get(name) != touched.other,
        )
        return self._collision_events.event(collision, name)

    def _scan(self, name: str, tick: Tick) -> Scan:
        distances = self._stage.arena.scan(
            name, self._beams, self._first, self._step, self._range_max
        )
        measured = self._errors.scan(name, distances, self._range_max, tick)
        ranges = measured.astype(np.float32)
        return Scan(name, ranges, self._first, self._step, self._range_max, tick.time)

    def _sightings(self, name: str, tick: Tick) -> Sightings:
        visible = self._stage.arena.visible(name, self._camera_fov, self._camera_range)
        names = self._stage.arena.markers
        measured = self._errors.recognised(name, visible, names, tick)
        return Sightings(name, measured, tick.time)


def _positive(option: str, value: float) -> float:
    positive(f"physics, {option}", value)
    return float(value)


def _directions(beams: int, fov: float) -> tuple[float, float]:
    """Direction of beam 0 and step in degrees, such that a beam points ahead if possible.

    At a full turn both edges would coincide, so one of them is omitted.
    """
    if beams < 1:
        raise PhysicsError(f"physics, beams: expected 1 or more, found {beams}")
    if not 0 < fov <= 360:
        raise PhysicsError(f"physics, fov: expected degrees above 0 and up to 360, found {fov}")
    if fov == 360:
        step = fov / beams
        # With one beam, the product is 0 and its negation would be -0.0.
        return 0.0 - step * (beams // 2), step
    return (-fov / 2, fov / (beams - 1)) if beams > 1 else (0.0, 0.0)


def _shortfall(command: DriveCommand, outcome: DriveOutcome) -> float:
    """Metres of its own command, as it knows it, that a robot did not drive."""
    return max(0.0, abs(command.forward_m) - abs(outcome.moved_m))
