"""Executes commands one after another: which velocity to send when, and when to stop.

Times are seconds of a monotonic clock passed in by the caller, so this module reads no clock.
"""

from __future__ import annotations

import math
import threading
from bisect import bisect_left
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from enum import Enum
from typing import Final

from minerva_bus import portable
from minerva_bus.log.recordings import needs_path, path_of
from minerva_bus.semantics.poses import Pose
from minerva_bus.world.readings import Scan
from minerva_services.options import check_positive
from minerva_services.physics.body import DriveCommand

_SPEED_GAIN: Final = 8.0
"""Speed per metre of remaining distance, 1/s, where braking allows more."""

_TURN_GAIN: Final = 9.0
"""The same for turns."""

_LATERAL_GAIN: Final = 12.0
"""Turn per metre of lateral error, 1/m²."""

_MAX_HEADING_ERROR: Final = 12.0
"""Heading error in degrees above which the robot turns before driving."""

_CORNER_RADIUS: Final = 0.015
"""Distance in metres from a corner at which the robot may turn."""


@dataclass(frozen=True, slots=True)
class Velocity:
    """Metres per second along the heading, degrees per second counter-clockwise."""

    speed: float = 0.0
    turn: float = 0.0


@dataclass(frozen=True, slots=True)
class MotorLimits:
    """Limits of the motors. Raises MisuseError unless all are above 0.

    Args:
        speed: maximum in m/s.
        turn: maximum in degrees/s.
        acceleration: maximum in m/s².
        turn_acceleration: maximum in degrees/s².

    """

    speed: float = 0.3
    turn: float = 90.0
    acceleration: float = 1.0
    turn_acceleration: float = 360.0

    def __post_init__(self) -> None:
        for field in fields(self):
            check_positive("ros2", field.name, getattr(self, field.name))

    def clipped(self, wanted: Velocity) -> Velocity:
        """The velocity, limited to the maximum."""
        return Velocity(_clip(wanted.speed, self.speed), _clip(wanted.turn, self.turn))

    def slewed(self, before: Velocity, wanted: Velocity, seconds: float) -> Velocity:
        """The velocity closest to the wanted one that is reachable within `seconds`."""
        speed, turn = self.acceleration * seconds, self.turn_acceleration * seconds
        return Velocity(
            before.speed + _clip(wanted.speed - before.speed, speed),
            before.turn + _clip(wanted.turn - before.turn, turn),
        )


@dataclass(frozen=True, slots=True)
class CommandPath:
    """A command from a pose: a turn at `start`, then a straight line to `end`."""

    start: Pose
    command: DriveCommand

    @property
    def end(self) -> Pose:
        """Where the command leads."""
        turned = self.start.compose(Pose(angle=self.command.turn_deg))
        return turned.compose(Pose(x=self.command.forward_m))

    def reached(self, pose: Pose) -> bool:
        """True if a robot that arrives from behind may turn here."""
        if not self.command.turn_deg:
            return True
        missing = pose.seen(self.start)
        return abs(missing.x) <= _CORNER_RADIUS


def steer(pose: Pose, wanted: Pose, limits: MotorLimits) -> Velocity:
    """The velocity towards a pose from which the robot can still stop there."""
    missing = pose.seen(wanted)
    off = missing.angle
    # In the frame of the wanted pose: x is the error along the line, y the error across it.
    straight = wanted.seen(pose)
    speed = _braking(-straight.x, _SPEED_GAIN, limits.speed, limits.acceleration)
    # Slow down with the heading error, or the robot would leave its line in a curve.
    speed *= max(0.0, 1.0 - abs(off) / _MAX_HEADING_ERROR)
    aside = math.degrees(speed * _LATERAL_GAIN * -straight.y)
    turn = _braking(off, _TURN_GAIN, limits.turn, limits.turn_acceleration)
    return limits.clipped(Velocity(speed, turn + aside))


def _braking(missing: float, gain: float, most: float, acceleration: float) -> float:
    """The fastest speed that still allows stopping within the missing distance."""
    stoppable = math.sqrt(2 * acceleration * abs(missing))
    return math.copysign(min(most, stoppable, gain * abs(missing)), missing)


def driven(pose: Pose, velocity: Velocity, seconds: float) -> Pose:
    """The pose after driving at a constant velocity, along an arc."""
    angle, dist = velocity.turn * seconds, velocity.speed * seconds
    half = math.radians(angle) / 2
    # The chord of an arc points in the direction that the arc has halfway.
    chord = dist * (portable.sin(half) / half if half else 1.0)
    return pose.compose(Pose(angle=angle / 2)).compose(Pose(x=chord)).compose(Pose(angle=angle / 2))


def _clip(value: float, most: float) -> float:
    return min(most, max(-most, value))


_MAX_POSES: Final = 500
MAX_CORRECTION: Final = Pose(0.5, 0.0, 45.0)
"""Jump in metres and degrees, beyond what can be driven, that still counts as a correction."""

_MAX_GAP_SECONDS: Final = 2.0
"""Maximum time in seconds for which a robot may have driven on unobserved."""


class OdometryTrack:
    """The last poses with times of the robot's clock; restarts if the clock is set back.

    `fastest` and `turning` are the robot's maximum speeds in metres and degrees per second.
    """

    def __init__(self, fastest: float, turning: float) -> None:
        self._fastest, self._turning = fastest, turning
        self._times = deque[float](maxlen=_MAX_POSES)
        self._poses = deque[Pose](maxlen=_MAX_POSES)
        self.restarts = 0

    @property
    def newest(self) -> Pose | None:
        """The latest pose."""
        return self._poses[-1] if self._poses else None

    @property
    def latest(self) -> float:
        """The time of the latest pose; -inf without any."""
        return self._times[-1] if self._times else -math.inf

    def add(self, time: float, pose: Pose) -> bool:
        """Add a pose; True if it is a jump that no robot can have driven."""
        jumped = False
        if self._times:
            elapsed, before = time - self._times[-1], self._poses[-1]
            if elapsed < 0:
                self._times.clear()
                self._poses.clear()
                self.restarts += 1
            # The time is limited, because after a long gap any distance could have been driven.
            jumped = self._jumps(before.seen(pose), min(max(0.0, elapsed), _MAX_GAP_SECONDS))
        if jumped:
            self._times.clear()
            self._poses.clear()
        self._times.append(time)
        self._poses.append(pose)
        return jumped

    def _jumps(self, moved: Pose, seconds: float) -> bool:
        most = MAX_CORRECTION.x + 2 * self._fastest * seconds
        turned = MAX_CORRECTION.angle + 2 * self._turning * seconds
        return portable.hypot(moved.x, moved.y) > most or abs(moved.angle) > turned

    def covers(self, time: float) -> bool:
        """True if the time is within the recorded history."""
        return bool(self._times) and self._times[0] <= time <= self._times[-1]

    def corrected(self, scan: Scan) -> Scan:
        """The scan with the robot's path during it, if that is known and still missing."""
        if not needs_path(scan):
            return scan
        # Of poses with equal times, only the last one counts.
        known = dict(zip(self._times, self._poses, strict=True))
        return replace(scan, path=path_of(scan, [*known], [*known.values()]))

    def at(self, time: float) -> Pose | None:
        """The interpolated pose at a time; outside the history, the nearest."""
        if not self._times:
            return None
        after = bisect_left(self._times, time)
        if after == 0:
            return self._poses[0]
        if after == len(self._times):
            return self._poses[-1]
        t0, t1 = self._times[after - 1], self._times[after]
        part = (time - t0) / (t1 - t0)
        start = self._poses[after - 1]
        moved = start.seen(self._poses[after])
        return start.compose(Pose(moved.x * part, moved.y * part, moved.angle * part))


_STOP_SECONDS: Final = 0.5
"""Seconds for which a stop is repeated before other nodes may drive the robot."""

_MIN_PROGRESS: Final = 0.005
"""Minimum approach in metres that counts as progress."""

_TURN_RADIUS: Final = 0.2
"""Distance in metres from the centre at which turning counts as much as driving."""

_STILL_TOLERANCE: Final = (0.01, 1.0)
"""Tolerance in metres and degrees for standing still."""

_MIN_LATENCY: Final = 0.02
_MAX_LATENCY: Final = 0.15
"""Latency bounds of odometry in seconds."""

STILL: Final = Velocity()


class State(Enum):
    """Progress of a command."""

    DRIVING = "driving"
    DONE = "done"
    BLOCKED = "blocked"
    LOST = "lost"


@dataclass(frozen=True, slots=True)
class DriveTolerances:
    """Precision and time-outs of commands. Raises MisuseError unless all are above 0.

    Args:
        near: distance in metres that may be missing when the next command begins.
        aligned: degrees that may be missing then.
        patience: seconds without progress after which a command counts as blocked.
        dead_man: seconds without a command after which the robot stops.

    """

    near: float = 0.1
    aligned: float = 10.0
    patience: float = 1.5
    dead_man: float = 0.5

    def __post_init__(self) -> None:
        for field in fields(self):
            check_positive("ros2", field.name, getattr(self, field.name))


@dataclass(slots=True)
class _Progress:
    """Best approach to the goal in metres, and the time of the last progress."""

    best: float = math.inf
    at: float = 0.0

    def stalled_for(self, missing: float, now: float) -> float:
        """Seconds without progress, given the metres that are missing now."""
        if missing < self.best - _MIN_PROGRESS:
            self.best, self.at = missing, now
        return now - self.at


_ODOMETRY: Final = "odometry"
"""The name of this sensor, that of its option."""


class SensorWatch:
    """The sensors without which the robot must not drive: which of them are silent.

    `tolerances` are seconds by sensor; with infinity, one reading is enough. Each sensor has one
    thread that calls `note`.
    """

    def __init__(self, tolerances: Mapping[str, float]) -> None:
        self._tolerances = dict(tolerances)
        self._arrivals = dict.fromkeys(tolerances, -math.inf)
        self._marks: dict[str, object] = {}
        self._faults = dict.fromkeys(tolerances, "")

    def note(self, sensor: str, now: float, mark: object, fault: str = "") -> None:
        """Process a reading, which counts as silence if it has a fault, or the last one's mark."""
        if sensor not in self._tolerances:
            return
        if not fault and self._marks.get(sensor) == mark:
            fault = "repeats its last reading"
        self._marks[sensor], self._faults[sensor] = mark, fault
        if not fault or math.isinf(self._tolerances[sensor]):
            self._arrivals[sensor] = now

    def silent(self, now: float) -> dict[str, float]:
        """The times of the last good readings of silent sensors; -inf without any."""
        return {
            sensor: at
            for sensor, at in self._arrivals.items()
            if math.isinf(at) or now - at > self._tolerances[sensor]
        }

    def missing(self) -> list[str]:
        """The sensors of which no good reading has arrived yet."""
        return [sensor for sensor, at in self._arrivals.items() if math.isinf(at)]

    def fault(self, sensor: str) -> str:
        """What is wrong with the last reading of a sensor, or an empty text."""
        return self._faults[sensor]


class Driver:
    """The goal in the frame of odometry, and the velocities that lead there.

    It stands while a sensor of `watch` is silent. Thread-safe; all calls are short.
    """

    def __init__(
        self, limits: MotorLimits, tolerances: DriveTolerances, watch: SensorWatch
    ) -> None:
        self.limits, self.tolerances, self.watch = limits, tolerances, watch
        self.track = OdometryTrack(limits.speed, limits.turn)
        self.jumps = 0
        self._lock = threading.RLock()
        self._goal: Pose | None = None
        self._path: CommandPath | None = None
        self._turns = False
        self._ends = 0.0
        self._updated = -math.inf
        self._wanted_until = -math.inf
        self._progress = _Progress()
        self._sent, self._sent_at = STILL, -math.inf
        self._stopped = False

    @property
    def goal(self) -> Pose | None:
        """Where the robot will be once the command is done; None before odometry."""
        return self._goal

    @property
    def offset(self) -> Pose:
        """The odometry pose relative to where the robot is believed to be."""
        with self._lock:
            goal = self._goal or Pose()
            return goal.seen(self.track.newest or goal)

    def set_goal(self, goal: Pose) -> None:
        """Continue from a predecessor's goal."""
        with self._lock:
            self._goal = goal

    def update(self, time: float, pose: Pose, now: float) -> None:
        """Process an odometry pose, with its time on the robot's own clock."""
        with self._lock:
            before = self.track.newest
            jumped = self.track.add(time, pose)
            # The first pose defines where the robot's frame of odometry lies.
            if before is None:
                self._start(pose)
            elif jumped:
                self.jumps += 1
                self._carry_over(before, pose)
            self.watch.note(_ODOMETRY, now, time)
            self._updated = now

    def halt(self, now: float) -> None:
        """Stop a robot that may still drive by the last velocity of a predecessor."""
        with self._lock:
            self._wanted_until = max(self._wanted_until, now)

    def begin(self, command: DriveCommand, seconds: float, now: float) -> None:
        """Start a command where the previous one should have ended."""
        with self._lock:
            assert self._goal is not None
            # From the goal, not from where the robot is: otherwise the errors of single commands
            # would add up, while the string assumes that each command ended at its goal.
            self._path = CommandPath(self._goal, command)
            self._goal = self._path.end
            self._turns = False
            self._ends = now + seconds
            self._progress = _Progress(at=now)
            self._wanted_until = now + seconds + self.tolerances.dead_man

    def state(self, now: float) -> State:
        """Progress of the command; asking keeps it alive."""
        with self._lock:
            if self.watch.silent(now):
                # Time without sensors does not count as time without progress.
                self._progress.at = now
                return State.LOST
            # A world that no longer asks has failed or is paused; then the robot must stop.
            self._wanted_until = max(self._wanted_until, now + self.tolerances.dead_man)
            if now < self._ends:
                self._progress.at = now
                return State.DRIVING
            # Standing still is done once its time is over.
            if self._path is None or self._path.command == DriveCommand():
                return State.DONE
            return self._arrival(now)

    def give_up(self) -> float:
        """Abort the command; the distance not driven in metres, 0 if within tolerance.

        If the shortfall is larger, the robot is assumed to be where it is along its heading.
        """
        with self._lock:
            course, self._path = self._path, None
            goal = self._goal or Pose()
            short = -goal.seen(self.track.newest or goal).x
            forward = course.command.forward_m if course is not None else 0.0
            # Overshooting has the opposite sign and is not a shortfall.
            if math.copysign(1.0, forward) * short <= self.tolerances.near:
                return 0.0
            self._goal = goal.compose(Pose(x=-short))
            return abs(short)

    def stop(self) -> None:
        """Stop permanently."""
        with self._lock:
            self._path, self._wanted_until = None, -math.inf
            self._stopped = True

    def velocity(self, now: float) -> Velocity | None:
        """The velocity to send now; None if nothing is to be driven."""
        with self._lock:
            if self._stopped:
                return STILL
            if now > self._wanted_until + _STOP_SECONDS:
                self._sent = STILL
                return None
            self._sent = self._chosen(now)
            self._sent_at = now
            return self._sent

    def _chosen(self, now: float) -> Velocity:
        if now > self._wanted_until or self._path is None or self.watch.silent(now):
            return STILL
        if self._path.command == DriveCommand() and self._is_there(now, *_STILL_TOLERANCE):
            return STILL
        pose = self._pose(now)
        # Latched: once the robot turns, a small error at the corner must not send it back.
        self._turns = self._turns or self._path.reached(pose)
        towards = self._path.end if self._turns else self._path.start
        wanted = steer(pose, towards, self.limits)
        # After a pause the elapsed time is long; it must not permit a jump in velocity.
        elapsed = min(max(0.0, now - self._sent_at), 0.2)
        return self.limits.slewed(self._sent, wanted, elapsed)

    def _arrival(self, now: float) -> State:
        if self._is_there(now, self.tolerances.near, self.tolerances.aligned):
            return State.DONE
        missing = self._missing(now)
        # The lateral error is left out: no command of this robot can reduce it.
        far = abs(missing.x) + _TURN_RADIUS * math.radians(abs(missing.angle))
        stalled = self._progress.stalled_for(far, now)
        return State.BLOCKED if stalled > self.tolerances.patience else State.DRIVING

    def _is_there(self, now: float, near: float, aligned: float) -> bool:
        missing = self._missing(now)
        return abs(missing.x) <= near and abs(missing.angle) <= aligned

    def _pose(self, now: float) -> Pose:
        """Estimated pose: the last odometry, extrapolated by the velocity sent since."""
        late = min(max(0.0, now - self._updated) + _MIN_LATENCY, _MAX_LATENCY)
        return driven(self.track.newest or Pose(), self._sent, late)

    def _missing(self, now: float) -> Pose:
        """Remaining displacement to the goal: ahead, left, and turn."""
        seen = (self._goal or Pose()).seen(self._pose(now))
        return Pose(-seen.x, -seen.y, -seen.angle)

    def _start(self, pose: Pose) -> None:
        """First odometry: a restored goal that is far away belongs to another odometry frame."""
        missing = pose.seen(self._goal or pose)
        far = portable.hypot(missing.x, missing.y) > MAX_CORRECTION.x + self.tolerances.near
        if self._goal is None or far:
            self.jumps += far
            self._goal = pose

    def _carry_over(self, before: Pose, after: Pose) -> None:
        """Odometry restarted elsewhere: keep the robot at its place and shift the goal."""
        if self._goal is not None:
            self._goal = after.compose(before.seen(self._goal))
        if self._path is not None:
            start = after.compose(before.seen(self._path.start))
            self._path = CommandPath(start, self._path.command)
