"""The physics world on the bus: robots drive in it, and it publishes what their sensors measure.

Table 4's gLaser and gCamera make events of that; a real laser and a real camera publish the same.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from minerva_bus.grammar.events import Event
from minerva_bus.semantics.geometry import interpret
from minerva_bus.world.readings import Scan, Sighting, Sightings
from minerva_bus.world.services import Device, Generator, Tick, View, WorldInfo
from minerva_services.physics.beam_model import BeamModel
from minerva_services.physics.body import Command, Odometer, Outcome
from minerva_services.physics.colliding import Collision, Teller
from minerva_services.physics.errors import PhysicsError, positive
from minerva_services.physics.geometry import PhysicalGeometry
from minerva_services.physics.imperfect import Imperfection
from minerva_services.physics.motion_model import MotionModel
from minerva_services.physics.noise import Noise
from minerva_services.physics.sighting_model import SightingModel
from minerva_services.physics.stage import Stage


class Physics(Device, Generator, draws=("eRepresent",), coupled=True, events=("eCollision",)):
    """Carries out the commands of each view in the tick that follows, and measures after it.

    `eCollision(shortfall)` tells a robot that it was stopped, and how many of the metres that it
    had commanded it did not drive; also by what and where, if the world's type has data for it: see
    `minerva_services.physics.colliding`.

    Args:
        beams: of each robot's laser.
        fov: the laser's field of view in degrees, centred on the heading.
        range_max: the laser's range in metres.
        camera_fov: the camera's field of view in degrees, centred on the heading.
        camera_range: in metres.
        laser_noise: standard deviation of the laser's distances in metres.
        laser_dropout: probability, 0 to 1, that a beam does not come back.
        drive_noise: standard deviation of driven distances, relative to them.
        turn_noise: standard deviation of turns in degrees.
        camera_noise: standard deviation of the camera's distances in metres.
        camera_angle_noise: standard deviation of the camera's angles in degrees.
        alpha1: α1 of `motion_model`: turns by turning, in variances.
        alpha2: turns by driving, rad²/m².
        alpha3: ways by driving.
        alpha4: ways by turning, m²/rad².
        laser_short: probability of a beam that ends before its obstacle, see `beam_model`.
        laser_decay: λ of these short ranges in 1/m.
        laser_random: probability of a beam that measures anything.
        camera_miss: probability that a marker in view is not recognised.
        camera_mistake: probability that one which is recognised is taken for another.

    """

    publishes = ("scan", "sightings")

    def __init__(
        self,
        beams: int = 90,
        fov: float = 360.0,
        range_max: float = 8.0,
        camera_fov: float = 70.0,
        camera_range: float = 5.0,
        laser_noise: float = 0.0,
        laser_dropout: float = 0.0,
        drive_noise: float = 0.0,
        turn_noise: float = 0.0,
        camera_noise: float = 0.0,
        camera_angle_noise: float = 0.0,
        alpha1: float = 0.0,
        alpha2: float = 0.0,
        alpha3: float = 0.0,
        alpha4: float = 0.0,
        laser_short: float = 0.0,
        laser_decay: float = 1.0,
        laser_random: float = 0.0,
        camera_miss: float = 0.0,
        camera_mistake: float = 0.0,
    ) -> None:
        self._beams = beams
        self._first, self._step = _directions(beams, fov)
        self._range_max = _positive("range_max", range_max)
        self._camera_fov = _positive("camera_fov", camera_fov)
        self._camera_range = _positive("camera_range", camera_range)
        self._errs = Imperfection(
            Noise(
                laser_noise,
                laser_dropout,
                drive_noise,
                turn_noise,
                camera_noise,
                camera_angle_noise,
            ),
            MotionModel(alpha1, alpha2, alpha3, alpha4),
            BeamModel(laser_short, laser_decay, laser_random, laser_dropout),
            SightingModel(camera_miss, camera_mistake),
        )
        self._begin()

    def _begin(self) -> None:
        self._stage = Stage()
        self._commands: dict[str, Command] = {}
        self._shown: int | None = None
        self._carried_out = -1
        self._stopped: dict[str, str] = {}

    def joined(self, world: WorldInfo) -> None:
        self._teller = Teller("physics", world, "eCollision", "shortfall")
        self._begin()

    def show(self, view: View) -> None:
        """φ of the view: bodies, walls and markers now, commands in the next tick.

        An agent whose step does not count has no command: its body stays with it.

        Raises:
            PhysicsError: something cannot stand where the view has it.

        """
        seen = PhysicalGeometry()
        interpret(view.scene, seen)
        self._stage.set(seen)
        self._shown = view.frame
        # A successor is shown the last view again, which its predecessor may have carried out.
        new = view.frame > self._carried_out
        moving = {name for name in seen.robots if name not in view.halted} if new else set[str]()
        self._commands = {name: seen.robots[name].command for name in moving}

    def generate(self, tick: Tick) -> Iterable[Event]:
        """Drive, then measure. Before the first view there is no world yet, and nothing of it."""
        if self._shown is None:
            return ()
        outcomes = self._drive(tick)
        for name in self._stage.arena.bodies:
            tick.publish("scan", self._scan(name, tick))
        for name in self._stage.arena.bodies:
            tick.publish("sightings", self._sightings(name, tick))
        self._carried_out, commands = self._shown, self._commands
        self._commands = {}
        stopped, self._stopped = self._stopped, {}
        return [
            self._collision(commands[one.name], one, stopped) for one in outcomes if one.collided
        ]

    def save(self) -> Mapping[str, Any]:
        """All that the views do not tell: where bodies are, and which view was carried out."""
        retired = self._stage.retired
        return {
            "arena": self._stage.arena.save(),
            "retired": [retired.driven_m, retired.collisions],
            "carried_out": self._carried_out,
            "stopped": self._stopped,
        }

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Go on from there; walls and markers come with the view that is shown next.

        Raises:
            PhysicsError: the value is not what `save` returns.

        """
        try:
            driven, collisions = saved["retired"]
            self._stage.arena.restore(saved["arena"])
            self._stage.retired = Odometer(float(driven), int(collisions))
            self._carried_out = int(saved["carried_out"])
            stopped = dict(saved.get("stopped", {}))
            self._stopped = {str(one): str(by) for one, by in stopped.items()}
        except PhysicsError:
            raise
        except (KeyError, TypeError, ValueError) as error:
            raise PhysicsError(f"not the saved state of a physics world: {error!r}") from error

    def report(self) -> Mapping[str, bool | int | float | str]:
        """Metres driven and moves that were stopped, of all robots together."""
        total = self._stage.total()
        return {"distance_driven": round(total.driven_m, 6), "collisions": total.collisions}

    def _drive(self, tick: Tick) -> tuple[Outcome, ...]:
        arena, after = self._stage.arena, dict[str, float]()
        for name, command in sorted(self._commands.items()):
            step = self._errs.on_drive(name, command.turn_deg, command.forward_m, tick)
            arena.drive(name, step.turn_deg, step.forward_m)
            after[name] = step.after_deg
        outcomes = arena.step(tick.dt)
        for name, turn in after.items():
            arena.turn(name, turn)
        return outcomes

    def _collision(self, command: Command, outcome: Outcome, before: Mapping[str, str]) -> Event:
        """What a robot is told, and known to be stopped by; `before` is who was by what."""
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
        return self._teller.one(collision, name)

    def _scan(self, name: str, tick: Tick) -> Scan:
        distances = self._stage.arena.scan(
            name, self._beams, self._first, self._step, self._range_max
        )
        measured = self._errs.on_scan(name, distances, self._range_max, tick)
        ranges = measured.astype(np.float32)
        return Scan(name, ranges, self._first, self._step, self._range_max, tick.time)

    def _sightings(self, name: str, tick: Tick) -> Sightings:
        visible = self._stage.arena.visible(name, self._camera_fov, self._camera_range)
        names = self._stage.arena.markers
        measured = self._errs.on_sightings(name, visible, names, tick)
        seen = tuple([Sighting(one.marker, one.dist_m, one.angle_deg) for one in measured])
        return Sightings(name, seen, tick.time)


def _positive(option: str, value: float) -> float:
    positive(f"physics, {option}", value)
    return float(value)


def _directions(beams: int, fov: float) -> tuple[float, float]:
    """Direction of beam 0 and from one to the next in degrees, so that one looks ahead if it can.

    The beams at both edges of a full turn would be one and the same, so one of them is left out.
    """
    if beams < 1:
        raise PhysicsError(f"physics, beams: expected 1 or more, found {beams}")
    if not 0 < fov <= 360:
        raise PhysicsError(f"physics, fov: expected degrees above 0 and up to 360, found {fov}")
    if fov == 360:
        step = fov / beams
        return 0.0 - step * (beams // 2), step
    return (-fov / 2, fov / (beams - 1)) if beams > 1 else (0.0, 0.0)


def _shortfall(command: Command, outcome: Outcome) -> float:
    """Metres of its own command, as it knows it, that a robot did not drive."""
    return max(0.0, abs(command.forward_m) - abs(outcome.moved_m))
