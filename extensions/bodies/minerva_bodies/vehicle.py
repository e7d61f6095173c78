"""A vehicle: Rapier's ray-cast wheels below a body, and motors that follow commands.

Each wheel is a ray below the body: a suspension carries the body where the ray meets something, and
friction moves it. All wheels are steered, so the vehicle turns on the spot and corrects its course
sideways. The motors know its position, as from an odometer without errors, and follow the commands:
a turn, then a distance along the new heading. An obstacle or a slope stops it, and nothing else
moves it from its course for long.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import rapier3d

from minerva_bus import portable

rapier: Any = rapier3d

_STIFFNESS, _DAMPING = 2000.0, 60.0
"""Of a suspension, 1/s² and 1/s: its force is a multiple of the body's mass."""
_GRIP = 1.0
"""Coefficient of friction of the wheels."""
_PULL = 10.0
"""Correction in m/s per metre, and in 1/s, of what the vehicle is off its course."""
_MOST = 2.0
"""Largest correction, m/s and rad/s."""
_GAIN = 0.5
"""Part of a wheel's deviation from its speed that its motor removes in a step."""
_PUSH = 7.0
"""Largest acceleration that the motors give, m/s²: more would lift the front."""
_STILL, _FACING = 2e-3, 5e-3
"""Deviation in metres and radians with which a vehicle without a command rests, brakes on."""


class Vehicle:
    """The wheels of a body.

    Args:
        body: its handle in Rapier's world.
        wheels: their sizes and places, each as `[..., sizes, pose]` of a solid.
        goal: x, y (m) and angle (degrees) to which its commands have led so far.

    """

    def __init__(self, body: Any, wheels: Sequence[Sequence[Any]], goal: list[float]) -> None:
        self.body, self.goal = body, goal
        self.turn = self.forward = 0.0
        self._filter = rapier.QueryFilter(exclude_rigid_body=body).exclude_sensors()
        self._wheels = rapier.DynamicRayCastVehicleController(body)
        self._wheels.index_up_axis, self._wheels.index_forward_axis = 2, 0
        self._places: list[tuple[float, float]] = []
        for *_, sizes, (x, y, z, *_rotation) in wheels:
            radius, travel = sizes
            tuning = rapier.WheelTuning(
                suspension_stiffness=_STIFFNESS,
                suspension_damping=_DAMPING,
                suspension_compression=_DAMPING,
                max_suspension_travel=travel,
                friction_slip=_GRIP,
            )
            # Its axle points to the right, so that it rolls along x.
            above = (x, y, z + travel)
            self._wheels.add_wheel(above, (0, 0, -1), (0, -1, 0), travel, radius, tuning)
            self._places.append((x, y))

    def heading(self, body: Any) -> tuple[float, float]:
        """Direction of the body's x axis over the ground, of length 1."""
        i, j, k, w = body.position.rotation.to_tuple()
        x, y = 1.0 - 2.0 * (j * j + k * k), 2.0 * (i * j + w * k)
        length = math.sqrt(x * x + y * y) or 1.0
        return x / length, y / length

    def drive(self, world: Any, part: float, dt: float, frame: float) -> None:
        """Set the motors for a step of physics, at whose end a part of the command is due.

        Args:
            world: Rapier's.
            part: from 0 to 1.
            dt: duration of the step, seconds.
            frame: duration of the command, seconds.

        """
        body = world.rigid_bodies[self.body]
        ahead, left = self.heading(body)
        off_x, off_y, off_turn = self._deviation(body, part, ahead, left)
        brakes = body.mass * 9.81 * dt / len(self._places)
        if not (self.turn or self.forward) and (
            off_x * off_x + off_y * off_y < _STILL * _STILL and abs(off_turn) < _FACING
        ):
            for wheel in range(len(self._places)):
                self._wheels.apply_engine_force(wheel, 0.0)
                self._wheels.set_brake(wheel, brakes)
        else:
            along = self._along()
            speed = self.forward / frame
            vx = along[0] * speed + _limited(_PULL * off_x)
            vy = along[1] * speed + _limited(_PULL * off_y)
            spin = math.radians(self.turn) / frame + _limited(_PULL * off_turn)
            self._roll(body, (vx * ahead + vy * left, vy * ahead - vx * left, spin), dt)
        self._wheels.update_vehicle(
            dt, world.rigid_bodies, world.colliders, world.query_pipeline, self._filter
        )

    def _along(self) -> tuple[float, float]:
        return portable.cos_sin(math.radians(self.goal[2] + self.turn))

    def _deviation(
        self, body: Any, part: float, ahead: float, left: float
    ) -> tuple[float, float, float]:
        """Metres and radians from the body to where it should be."""
        x, y, angle = self.goal
        (cos, sin), way = self._along(), self.forward * part
        to = portable.cos_sin(math.radians(angle + self.turn * part))
        bx, by, _ = body.position.translation.to_tuple()
        turn = portable.atan2(ahead * to[1] - left * to[0], ahead * to[0] + left * to[1])
        return x + way * cos - bx, y + way * sin - by, turn

    def _roll(self, body: Any, wanted: tuple[float, float, float], dt: float) -> None:
        """Steer each wheel along its way, and push it towards its speed.

        Args:
            body: Rapier's.
            wanted: speed ahead and to the left (m/s), and spin (rad/s).
            dt: duration of a step.

        """
        vx, vy, spin = wanted
        ahead, left = self.heading(body)
        east, north, _ = body.linvel.to_tuple()
        now_x, now_y = east * ahead + north * left, north * ahead - east * left
        _, _, turning = body.angvel.to_tuple()
        share = _GAIN * body.mass / len(self._places) / dt
        most = _PUSH * body.mass / len(self._places)
        for wheel, (x, y) in enumerate(self._places):
            dx, dy = vx - spin * y, vy + spin * x
            # The wheel turns by at most a quarter, and rolls backwards otherwise.
            if dx < 0.0:
                dx, dy = -dx, -dy
                sense = -1.0
            else:
                sense = 1.0
            speed = math.sqrt(dx * dx + dy * dy)
            cos, sin = (dx / speed, dy / speed) if speed else (1.0, 0.0)
            rolls = (now_x - turning * y) * cos + (now_y + turning * x) * sin
            self._wheels.set_steering(wheel, portable.atan2(sin, cos))
            self._wheels.set_brake(wheel, 0.0)
            push = share * (sense * speed - rolls)
            self._wheels.apply_engine_force(wheel, max(-most, min(most, push)))

    def finish(self, body: Any, after: float) -> tuple[float, float, float]:
        """End the command, with another turn by `after` degrees that is part of no command.

        Returns the direction of the command and the metres along it that the body is behind.
        """
        cos, sin = self._along()
        self.goal = [
            self.goal[0] + self.forward * cos,
            self.goal[1] + self.forward * sin,
            self.goal[2] + self.turn + after,
        ]
        x, y, _ = body.position.translation.to_tuple()
        behind = (self.goal[0] - x) * cos + (self.goal[1] - y) * sin
        sense = -1.0 if self.forward < 0.0 else 1.0
        self.turn = self.forward = 0.0
        return sense * cos, sense * sin, sense * behind

    def give_way(self, along: tuple[float, float], metres: float) -> None:
        """Take back a part of the last command's way."""
        self.goal[0] -= along[0] * metres
        self.goal[1] -= along[1] * metres


def _limited(value: float) -> float:
    return max(-_MOST, min(_MOST, value))
