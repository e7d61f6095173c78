"""Output to a robot: velocities, simulation time, and its pose on the map."""

from __future__ import annotations

import time
from typing import Any

from minerva_bus.semantics.poses import Pose
from minerva_services.bridges.ros2 import messages as types
from minerva_services.bridges.ros2.messages import messages
from minerva_services.bridges.ros2.session import Ros2Session, TopicPublisher
from minerva_services.bridges.ros2.steering import Velocity
from minerva_services.bridges.ros2.stepping import ClockStep


class Motors:
    """Publishes on the configured topics; publishes nothing before `declare`.

    `stamped`: velocities are TwistStamped messages in the frame `base`. `clock` is a topic of Clock
    messages, `map_frame` the frame in which /tf places the odometry frame.
    """

    def __init__(self, cmd_vel: str, clock: str, map_frame: str, base: str, *, stamped: bool):
        self._cmd_vel, self._clock_topic, self._map_frame = cmd_vel, clock, map_frame
        self._base, self._stamped = base, stamped
        self._wheels: TopicPublisher | None = None
        self._clock: TopicPublisher | None = None
        self._transforms: TopicPublisher | None = None

    def declare(self, session: Ros2Session) -> None:
        """Create the publishers of a session. Raises SourceError if it is lost."""
        if self._map_frame:
            self._transforms = session.publisher("/tf", types.TRANSFORMS)
        if self._clock_topic:
            self._clock = session.publisher(self._clock_topic, types.CLOCK)
        twist = types.TWIST_STAMPED if self._stamped else types.TWIST
        self._wheels = session.publisher(self._cmd_vel, twist)

    def go(self, velocity: Velocity) -> None:
        """Publish a velocity that applies from now on."""
        if self._wheels is not None:
            self._wheels.put(self._twist(velocity, time.time_ns()))

    def step(self, step: ClockStep) -> None:
        """Publish a simulation step: a velocity and the time until which it applies; repeatable."""
        if self._wheels is not None and self._clock is not None:
            # The velocity first: the clock lets the simulation move.
            self._wheels.put(self._twist(step.velocity, step.begin))
            self._clock.put(messages().make(types.CLOCK, clock=messages().time(step.end)))

    def place(self, odometry_frame: str, at: Pose) -> None:
        """Publish the pose of the odometry frame on the map."""
        if self._transforms is None:
            return
        header = messages().header(self._map_frame, time.time_ns())
        transform = messages().transform(header, odometry_frame, at.x, at.y, at.angle)
        self._transforms.put(messages().make(types.TRANSFORMS, transforms=[transform]))

    def _twist(self, velocity: Velocity, nanoseconds: int) -> Any:
        twist = messages().twist(velocity.speed, velocity.turn)
        if not self._stamped:
            return twist
        header = messages().header(self._base, nanoseconds)
        return messages().make(types.TWIST_STAMPED, header=header, twist=twist)
