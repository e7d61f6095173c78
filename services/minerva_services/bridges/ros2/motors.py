"""What a robot is told: velocities, the time of a simulation, and where it stands on the map."""

from __future__ import annotations

import time
from typing import Any

from minerva_bus.world.poses import Pose
from minerva_services.bridges.ros2 import messages as types
from minerva_services.bridges.ros2.messages import messages
from minerva_services.bridges.ros2.session import Publisher, Session
from minerva_services.bridges.ros2.steering import Velocity
from minerva_services.bridges.ros2.stepping import Step


class Motors:
    """Publishes on the topics that have names; nothing is said before `declare`.

    `stamped`: velocities are TwistStamped messages, in the frame `base`. `clock` is a topic of
    Clock messages, `map_frame` the frame in which /tf says where odometry's frame lies.
    """

    def __init__(self, cmd_vel: str, clock: str, map_frame: str, base: str, *, stamped: bool):
        self._cmd_vel, self._clock_topic, self._map_frame = cmd_vel, clock, map_frame
        self._base, self._stamped = base, stamped
        self._wheels: Publisher | None = None
        self._clock: Publisher | None = None
        self._transforms: Publisher | None = None

    def declare(self, session: Session) -> None:
        """Make the publishers of a session. Raises SourceError where it is lost."""
        if self._map_frame:
            self._transforms = session.publisher("/tf", types.TRANSFORMS)
        if self._clock_topic:
            self._clock = session.publisher(self._clock_topic, types.CLOCK)
        twist = types.TWIST_STAMPED if self._stamped else types.TWIST
        self._wheels = session.publisher(self._cmd_vel, twist)

    def go(self, velocity: Velocity) -> None:
        """Tell a velocity that counts from now on."""
        if self._wheels is not None:
            self._wheels.put(self._twist(velocity, time.time_ns()))

    def step(self, step: Step) -> None:
        """Tell a simulation how fast and until when; what is told twice is asked twice."""
        if self._wheels is not None and self._clock is not None:
            self._wheels.put(self._twist(step.velocity, step.begin))
            self._clock.put(messages().make(types.CLOCK, clock=messages().time(step.end)))

    def place(self, odometry_frame: str, at: Pose) -> None:
        """Tell where odometry's frame lies on the map."""
        if self._transforms is None:
            return
        header = messages().header(self._map_frame, time.time_ns())
        one = messages().transform(header, odometry_frame, at.x, at.y, at.angle)
        self._transforms.put(messages().make(types.TRANSFORMS, transforms=[one]))

    def _twist(self, velocity: Velocity, nanoseconds: int) -> Any:
        twist = messages().twist(velocity.speed, velocity.turn)
        if not self._stamped:
            return twist
        header = messages().header(self._base, nanoseconds)
        return messages().make(types.TWIST_STAMPED, header=header, twist=twist)
