"""Carries out one command after another: which velocity when, and when to stop.

Times are seconds of one monotonic clock that is passed in, so there is no clock in here.
"""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass
from enum import Enum
from typing import Final

from minerva_bus import portable
from minerva_bus.world.poses import Pose
from minerva_services.bridges.ros2.geometry import Command
from minerva_services.bridges.ros2.steering import Course, Limits, Velocity, driven, steer
from minerva_services.bridges.ros2.track import SUDDEN, Track

_STOPPING: Final = 0.5
"""Seconds for which a stop is repeated, before others may drive the robot."""

_PROGRESS: Final = 0.005
"""Metres that a robot must come nearer to be on its way."""

_RIM: Final = 0.2
"""Metres from a robot's centre at which turning counts as much as driving."""

_REST: Final = (0.01, 1.0)
"""Metres and degrees that may be missing where the robot is to stand."""

_DELAY: Final = 0.02
_LATEST: Final = 0.15
"""Seconds that odometry is late, at least and at most."""

STILL: Final = Velocity()


class State(Enum):
    """How a command is doing."""

    DRIVING = "driving"
    DONE = "done"
    BLOCKED = "blocked"
    LOST = "lost"


@dataclass(frozen=True, slots=True)
class Care:
    """How exactly and for how long commands are carried out.

    `near` metres and `aligned` degrees are what may be missing when the next command begins; one
    that comes no nearer for `patience` seconds is blocked. Without odometry for `silence` seconds,
    or without a command for `dead_man` seconds, the robot stops.
    """

    near: float = 0.1
    aligned: float = 10.0
    patience: float = 1.5
    silence: float = 0.5
    dead_man: float = 0.5


class Driver:
    """Where a robot should be in the frame of its odometry, and what takes it there.

    Any thread may call; each call is short.
    """

    def __init__(self, limits: Limits, care: Care) -> None:
        self.limits, self.care = limits, care
        self.track = Track(limits.speed, limits.turn)
        self.jumps = 0
        self._lock = threading.RLock()
        self._goal: Pose | None = None
        self._course: Course | None = None
        self._turns = False
        self._ends = 0.0
        self._heard = -math.inf
        self._wanted_until = -math.inf
        self._best = math.inf
        self._best_at = 0.0
        self._sent, self._sent_at = STILL, -math.inf
        self._stopped = False

    @property
    def goal(self) -> Pose | None:
        """Where the robot is believed to be once the command is done; None before odometry."""
        return self._goal

    @property
    def offset(self) -> Pose:
        """Where odometry has the robot, as seen from where it is believed to be."""
        with self._lock:
            goal = self._goal or Pose()
            return goal.seen(self.track.newest or goal)

    def set_goal(self, goal: Pose) -> None:
        """Go on from where a predecessor had brought it."""
        with self._lock:
            self._goal = goal

    def heard(self, time: float, pose: Pose, now: float) -> None:
        """Odometry has the robot at a pose, at a time of the robot's own clock."""
        with self._lock:
            before = self.track.newest
            jumped = self.track.add(time, pose)
            if before is None:
                self._meet(pose)
            elif jumped:
                self.jumps += 1
                self._carry_over(before, pose)
            self._heard = now

    def listening(self, now: float) -> bool:
        """Whether odometry is heard."""
        return now - self._heard <= self.care.silence

    def begin(self, command: Command, seconds: float, now: float) -> None:
        """Set out on a command, from where the one before should have led."""
        with self._lock:
            assert self._goal is not None
            self._course = Course(self._goal, command)
            self._goal = self._course.end
            self._turns = False
            self._ends = now + seconds
            self._best, self._best_at = math.inf, now
            self._wanted_until = now + seconds + self.care.dead_man

    def state(self, now: float) -> State:
        """How the command is doing; it stays wanted as long as this is asked."""
        with self._lock:
            if not self.listening(now):
                self._best_at = now
                return State.LOST
            self._wanted_until = max(self._wanted_until, now + self.care.dead_man)
            if now < self._ends:
                self._best_at = now
                return State.DRIVING
            if self._course is None or self._course.command == Command():
                return State.DONE
            return self._arrival(now)

    def give_up(self) -> float:
        """Want no more of this command; the metres that were not driven, 0 if nearly all were.

        With so much missing the robot is taken to be where it is along its heading.
        """
        with self._lock:
            course, self._course = self._course, None
            goal = self._goal or Pose()
            short = -goal.seen(self.track.newest or goal).x
            forward = course.command.forward if course is not None else 0.0
            if math.copysign(1.0, forward) * short <= self.care.near:
                return 0.0
            self._goal = goal.then(Pose(x=-short))
            return abs(short)

    def stop(self) -> None:
        """Want nothing any more."""
        with self._lock:
            self._course, self._wanted_until = None, -math.inf
            self._stopped = True

    def velocity(self, now: float) -> Velocity | None:
        """What to tell the motors now; None: nothing, for nobody wants the robot to move."""
        with self._lock:
            if self._stopped:
                return STILL
            if now > self._wanted_until + _STOPPING:
                self._sent = STILL
                return None
            self._sent = self._chosen(now)
            self._sent_at = now
            return self._sent

    def _chosen(self, now: float) -> Velocity:
        if now > self._wanted_until or not self.listening(now) or self._course is None:
            return STILL
        if self._course.command == Command() and self._is_there(now, *_REST):
            return STILL
        pose = self._pose(now)
        self._turns = self._turns or self._course.reached(pose)
        towards = self._course.end if self._turns else self._course.start
        wanted = steer(pose, towards, self.limits)
        elapsed = min(max(0.0, now - self._sent_at), 0.2)
        return self.limits.slewed(self._sent, wanted, elapsed)

    def _arrival(self, now: float) -> State:
        if self._is_there(now, self.care.near, self.care.aligned):
            return State.DONE
        missing = self._missing(now)
        far = abs(missing.x) + _RIM * math.radians(abs(missing.angle))
        if far < self._best - _PROGRESS:
            self._best, self._best_at = far, now
        return State.BLOCKED if now - self._best_at > self.care.patience else State.DRIVING

    def _is_there(self, now: float, near: float, aligned: float) -> bool:
        missing = self._missing(now)
        return abs(missing.x) <= near and abs(missing.angle) <= aligned

    def _pose(self, now: float) -> Pose:
        """Where the robot is: where odometry had it, and what it was told since."""
        late = min(max(0.0, now - self._heard) + _DELAY, _LATEST)
        return driven(self.track.newest or Pose(), self._sent, late)

    def _missing(self, now: float) -> Pose:
        """What is missing to the goal: along its heading, to its left, and of the turn."""
        seen = (self._goal or Pose()).seen(self._pose(now))
        return Pose(-seen.x, -seen.y, -seen.angle)

    def _meet(self, pose: Pose) -> None:
        """The first odometry: a goal from before it that is not near was of another one."""
        missing = pose.seen(self._goal or pose)
        far = portable.hypot(missing.x, missing.y) > SUDDEN.x + self.care.near
        if self._goal is None or far:
            self.jumps += far
            self._goal = pose

    def _carry_over(self, before: Pose, after: Pose) -> None:
        """Odometry counts anew from elsewhere, and the robot stands where it stood."""
        if self._goal is not None:
            self._goal = after.then(before.seen(self._goal))
        if self._course is not None:
            start = after.then(before.seen(self._course.start))
            self._course = Course(start, self._course.command)
