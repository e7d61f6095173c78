"""A robot's base on its network: its motors, its topics, and commands in time or step by step.

A simulation that is driven by /clock advances only as published here, so frame and robot wait for
each other: its readings belong to exactly the pose that its command has reached.
"""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final, TypeVar, cast

from minerva_bus import portable
from minerva_bus.errors import MisuseError, nearest
from minerva_bus.log.recordings import span
from minerva_bus.semantics.poses import Pose
from minerva_bus.world.readings import Displacement, Mount, Scan, Sightings
from minerva_bus.world.services import Tick
from minerva_services.bridges.ros2.driver import (
    STILL,
    Driver,
    DriveTolerances,
    MotorLimits,
    SensorWatch,
    State,
    Velocity,
    driven,
)
from minerva_services.bridges.ros2.layout import Ros2Network
from minerva_services.bridges.ros2.network import NetworkLink, Ros2Session, TopicPublisher
from minerva_services.bridges.ros2.qos import DEFAULT
from minerva_services.bridges.ros2.uses import WATCH, TopicUse, topic_uses, transforms_uses
from minerva_services.bridges.ros_messages import Frames, GarbageError, readings
from minerva_services.bridges.ros_messages import messages as types
from minerva_services.bridges.ros_messages.conversion import Conversion, LivePlaces
from minerva_services.bridges.ros_messages.frames import UnplacedError, mount_of
from minerva_services.bridges.ros_messages.messages import (
    DETECTIONS,
    LASER_SCAN,
    ODOMETRY,
    TRANSFORMS,
    messages,
)
from minerva_services.bridging.bridge import Counting, log
from minerva_services.options import check_positive
from minerva_services.physics.body import DriveCommand
from minerva_services.physics.geometry import Robot
from minerva_services.sensors.clocks import ClockWatch
from minerva_services.sensors.playback import checked_offset

_MAX_DELAY_FRAMES: Final = 5.0
"""Delay in frames up to which the schedule is kept; beyond it, it restarts."""


@dataclass(slots=True)
class FramePacer:
    """When the current command should end.

    The time that the world needs between two commands, to measure, decide and distribute, counts
    towards the second: meanwhile the robot still drives towards the end of the first.
    """

    due: float = -math.inf

    def begin(self, seconds: float, now: float) -> float:
        """The time left for a command that begins now, of its nominal duration."""
        late = now - self.due
        # A late command gets the rest of its time, at least 0 s; a pause starts a new schedule.
        self.due = (
            max(self.due + seconds, now) if late < _MAX_DELAY_FRAMES * seconds else now + seconds
        )
        return self.due - now


_WITHOUT_ROBOT: Final = "frames without robot"
_BLIND_SECONDS: Final = 0.5
_POLL_SECONDS: Final = 0.005
_SILENT_SECONDS: Final = 3.0


@dataclass(frozen=True, slots=True)
class BaseOptions:
    """A robot's topics, frames and rates. Raises MisuseError.

    Args:
        scan: topic of LaserScan messages.
        odometry: topic of Odometry messages; "": the motors are assumed to do what they are sent.
        detections: topic of Detection3DArray messages, whose classes are markers.
        cmd_vel: topic of the velocities.
        stamped: velocities are TwistStamped messages, not Twist.
        base: the robot's base frame.
        mount: "x, y, degrees" of the laser on the robot; "": from /tf_static.
        time_offset: seconds added to the times of scans if the lidar's clock differs from that of
            odometry.
        map_frame: if set, the transform from it to the odometry frame is published on /tf.
        rate: velocities per second.
        clock: topic of Clock messages, for a simulation driven by them: it receives the time, and
            must answer each step with all its readings of that time.
        watch: other topics without which it must not drive, such as that of a depth camera: by
            topic the type of its messages.
        blind: seconds without a reading after which the robot stops, and counts as missing; by
            option or watched topic: {scan = 1.0}. 0: it drives on.
        qos: the quality of service of topics, by option: {scan = "sensor_data"}.

    """

    scan: str = "scan"
    odometry: str = "odom"
    detections: str = "detections"
    cmd_vel: str = "cmd_vel"
    stamped: bool = False
    base: str = "base_link"
    mount: str = ""
    time_offset: float = 0.0
    map_frame: str = ""
    rate: float = 20.0
    clock: str = ""
    watch: Mapping[str, Any] | None = None
    blind: Mapping[str, Any] | None = None
    qos: Mapping[str, Any] | None = None

    def __post_init__(self) -> None:
        for name, table, example in (
            ("watch", self.watch, '{"depth/points" = "sensor_msgs/msg/PointCloud2"}'),
            ("blind", self.blind, "{scan = 1.0}"),
        ):
            if not isinstance(table, Mapping | None):
                raise MisuseError(
                    f"ros2_robot: {name} is {table!r:.60}; expected a table, {example}"
                )
        mount_of(self.mount)
        checked_offset(self.time_offset)
        check_positive("ros2", "rate", self.rate)
        if self.clock and not self.odometry:
            raise MisuseError("ros2_robot: a robot driven by a clock must publish odometry")

    @property
    def sends_stamps(self) -> bool:
        """A simulation needs the time from which a velocity applies."""
        return self.stamped or bool(self.clock)

    def uses(self, network: Ros2Network) -> tuple[TopicUse, ...]:
        """The topics that are configured. Raises MisuseError for their quality of service."""
        network.name(self.cmd_vel)
        uses = (
            TopicUse("scan", self.scan, LASER_SCAN),
            TopicUse("odometry", self.odometry, ODOMETRY),
            TopicUse("detections", self.detections, DETECTIONS),
            TopicUse(
                "cmd_vel", self.cmd_vel, types.TWIST_STAMPED if self.sends_stamps else types.TWIST,
                sends=True, exclusive=True, qos=DEFAULT,
                instead="stop other programs that take its velocities",
            ),
            TopicUse("clock", self.clock, types.CLOCK, sends=True, qos=DEFAULT),
            *(TopicUse(f"{WATCH}{topic}", topic, str(kind))
              for topic, kind in (self.watch or {}).items()),
        )  # fmt: skip
        mounts = transforms_uses(network, needed=mount_of(self.mount) is None and bool(self.scan))
        return topic_uses(network, [*mounts, *uses], self.qos)

    def check(self) -> None:
        """Raise MisuseError for a watched topic whose type is not known. Needs rosbags."""
        known = messages().store.fielddefs
        for topic, kind in (self.watch or {}).items():
            if kind not in known:
                near = nearest(str(kind), list(known), "; see the list of minerva doctor --ros2")
                raise MisuseError(f"ros2_robot: watch: {topic}: the type {kind} is not known{near}")

    def tolerances(self) -> dict[str, float]:
        """By sensor, the seconds of silence after which the robot stops. Raises MisuseError."""
        usual = {name: _BLIND_SECONDS for name in ("odometry", "scan") if getattr(self, name)}
        # The motors' own time takes the place of odometry.
        usual |= {"odometry": _BLIND_SECONDS} | dict.fromkeys(self.watch or (), _BLIND_SECONDS)
        known = [*usual, *(["detections"] if self.detections else [])]
        for name, seconds in (self.blind or {}).items():
            if name not in known:
                near = nearest(name, known, f"it may have {', '.join(known)}")
                raise MisuseError(f"ros2_robot: blind has {name!r}, which is no sensor{near}")
            is_number = isinstance(seconds, int | float) and not isinstance(seconds, bool)
            # Without odometry, nothing says where the robot drives.
            if not is_number or not seconds >= (name == "odometry") * 0.01:
                least = "seconds" if name == "odometry" else "seconds, or 0 for never"
                raise MisuseError(f"ros2_robot: blind.{name} is {seconds!r:.40}; expected {least}")
            usual[name] = seconds or math.inf
        # In step with a clock, frames wait for all readings.
        return dict.fromkeys(usual, math.inf) if self.clock else usual


class MobileBase:
    """Drives a robot by its odometry, and buffers its readings.

    A world's frames call `carry_out` and `publish`; the link's thread calls `_declare` and `_beat`.
    """

    def __init__(
        self, network: Ros2Network, limits: MotorLimits, tolerances: DriveTolerances,
        options: BaseOptions,
    ) -> None:  # fmt: skip
        self._options, self._router = options, network.router
        self.driver = Driver(limits, tolerances, SensorWatch(options.tolerances()))
        self._pacer = FramePacer()
        self._stepper = self._new_stepper() if options.clock else None
        notify = self._stepper.notify if self._stepper else lambda: None
        self._sensors = SensorBuffers(
            options.base, mount_of(options.mount), self._moved, self._measured, notify,
            options.time_offset,
        )  # fmt: skip
        self._publisher = ReadingPublisher(self.driver, self._sensors)
        self._uses = options.uses(network)
        self._motors = Motors(options.map_frame, options.base, stamped=options.sends_stamps)
        self._sent = STILL, time.monotonic()
        self._begun = time.monotonic()
        self._is_absent = False
        self._silent = dict[str, float]()
        self._topics = {
            use.option.removeprefix(WATCH): f"/{network.name(use.topic)}" for use in self._uses
        }
        self._link = NetworkLink(
            network, "minerva_motors", self._declare, self._beat, 1.0 / options.rate,
            self._uses,
        )  # fmt: skip

    def connect(self) -> None:
        """Start connecting to the robot, in a thread of the link."""
        self._link.start()

    def close(self) -> None:
        """Stop the motors and leave the network."""
        self.driver.stop()
        self._link.close()

    @property
    def counts(self) -> dict[str, int]:
        """Skipped messages by reason, and jumps of odometry."""
        jumps = self.driver.jumps + self.driver.track.restarts
        return {**self._sensors.counts, "odometry jumps": jumps}

    @property
    def state(self) -> str:
        """State of the link, as reported to people."""
        state = self._link.state
        silent = self.driver.watch.silent(self._now())
        if state != "open" or not silent:
            return state
        return f"open, but no {' and no '.join(map(self._described, silent))}"

    # --- called by the world's frames ---

    def is_ready(self, seconds: float) -> bool:
        """Whether all sensors have been there: nothing is driven blindly.

        Waits for them for `seconds`, or in lockstep until they are there.
        """
        begin = time.monotonic()
        while missing := self._missing():
            now = time.monotonic()
            if not self._is_absent and now - self._begun > _SILENT_SECONDS:
                self._is_absent = True
                log(
                    f"no robot yet: no {' and no '.join(map(self._described, missing))} from"
                    f" {self._router} since {_time_of_day(self._begun)}"
                    f"; connect it, and compare: minerva doctor --ros2 {self._router}"
                )
            if self._stepper is None and now - begin >= seconds:
                self._sensors.count(_WITHOUT_ROBOT)
                return False
            time.sleep(_POLL_SECONDS)
        if self._is_absent:
            self._is_absent = False
            log(f"the robot at {self._router} is there")
        return True

    def begin(self, command: DriveCommand, seconds: float) -> None:
        """Begin a command of a frame."""
        if self._stepper is None:
            now = time.monotonic()
            self.driver.begin(command, self._pacer.begin(seconds, now), now)
            # Otherwise the first velocity of the command would wait for the next beat.
            self._link.wake()

    def carry_out(self, command: DriveCommand, seconds: float) -> float | None:
        """Execute the command that has begun; the distance not driven in metres, at its end.

        None if a sensor has been silent for `seconds`: then the robot stands, and the command goes
        on with the next call.
        """
        if self._stepper is not None:
            return self._stepper.carry_out(command, seconds)
        since = math.inf
        while (state := self.driver.state(now := time.monotonic())) is not State.DONE:
            self._log_silence(now)
            if state is State.BLOCKED:
                return self.driver.give_up()
            since = min(since, now) if state is State.LOST else math.inf
            if now - since >= seconds:
                self._sensors.count(_WITHOUT_ROBOT)
                return None
            time.sleep(_POLL_SECONDS)
        return 0.0

    def place(self, ordered: Robot) -> None:
        """Publish the pose of the odometry frame on the map, given the string's robot."""
        goal, command = self.driver.goal, ordered.command
        turned = Pose().compose(ordered.believed).compose(Pose(angle=command.turn_deg))
        world = turned.compose(Pose(x=command.forward_m))
        if goal is not None:
            self._motors.place(self._sensors.odometry_frame, world.compose(goal.seen(Pose())))

    def publish(self, tick: Tick, robot: str) -> None:
        """Publish the readings of this tick."""
        self._publisher.publish(tick, robot)

    def _missing(self) -> list[str]:
        return self.driver.watch.missing()

    def _log_silence(self, now: float) -> None:
        """Log once which sensors are silent, and once which have returned."""
        silent = self.driver.watch.silent(now)
        for sensor, at in silent.items():
            if sensor not in self._silent:
                log(
                    f"no {self._described(sensor)} from {self._router} since"
                    f" {_time_of_day(max(at, self._begun))}; stopped until it returns"
                )
        for sensor in self._silent.keys() - silent.keys():
            goes_on = "" if silent else "; driving on"
            log(f"{self._described(sensor)} from {self._router} has returned{goes_on}")
        self._silent = silent

    def _described(self, sensor: str) -> str:
        """The topic of a sensor, and what is wrong with its last reading."""
        fault = self.driver.watch.fault(sensor)
        return self._topics.get(sensor, "link") + (f" ({fault})" if fault else "")

    # --- called by threads of the link and of Zenoh ---

    def _declare(self, session: Ros2Session) -> None:
        if self._stepper is None:
            self.driver.halt(time.monotonic())
        self._sensors.listen(session, self._uses)
        self._motors.declare(session, self._uses)

    def _beat(self) -> None:
        """Send the current velocity, or the current step of the simulation."""
        if self._stepper is not None:
            self._motors.step(self._stepper.step)
            return
        now = time.monotonic()
        velocity = self.driver.velocity(now)
        if velocity is not None:
            self._motors.go(velocity)
        if not self._options.odometry:
            # Without odometry the motors are assumed to do exactly what was sent.
            pose, elapsed = self.driver.track.newest or Pose(), now - self._sent[1]
            self.driver.update(now, driven(pose, self._sent[0], elapsed), now)
        self._sent = velocity or STILL, now

    def _measured(self, sensor: str, fault: str, mark: object) -> None:
        self.driver.watch.note(sensor, time.monotonic(), mark, fault)

    def _moved(self, stamp: float, pose: Pose) -> None:
        jumps = self.driver.jumps
        self.driver.update(stamp, pose, time.monotonic() if self._stepper is None else stamp)
        if self.driver.jumps > jumps:
            self._sensors.pass_over(
                "odometry jumps",
                f"odometry from {self._router} jumped; assuming that the robot has not moved",
            )

    def _now(self) -> float:
        """Seconds of the clock by which the robot drives."""
        return time.monotonic() if self._stepper is None else self._stepper.now

    def _new_stepper(self) -> Stepper:
        options = self._options

        def measured() -> float:
            sensors = self._sensors.measured(
                scan=bool(options.scan), detections=bool(options.detections)
            )
            return min(self.driver.track.latest, sensors)

        return Stepper(self.driver, measured, lambda: self._link.wake(), self._router)


def _time_of_day(at: float) -> str:
    """A time of the monotonic clock, as people read it."""
    return time.strftime("%H:%M:%S", time.localtime(time.time() - time.monotonic() + at))


NANOSECONDS: Final = 1_000_000_000
BEGIN: Final = NANOSECONDS
"""Start of the clock; ROS interprets 0 as a missing clock."""

ROUNDING: Final = 1e-6
"""Metres and degrees below which a deviation counts as rounding."""

# 50 steps per second, where the driver steers by odometry.
_STEP_NANOSECONDS: Final = NANOSECONDS // 50
# Seconds after which a missing answer is logged.
_SILENT_AFTER: Final = 3.0


@dataclass(frozen=True, slots=True)
class ClockStep:
    """A velocity, and the interval of the clock in nanoseconds during which it applies."""

    velocity: Velocity
    begin: int
    end: int


class Stepper:
    """Takes a robot through its commands; the link's beat publishes the step repeatedly.

    `measured` is the time, in seconds of the clock, up to which all readings have arrived; `wake`
    makes the link publish the step at once.
    """

    def __init__(
        self, driver: Driver, measured: Callable[[], float], wake: Callable[[], None], where: str
    ) -> None:
        self._driver, self._measured, self._wake, self._where = driver, measured, wake, where
        self._answered = threading.Condition()
        self.step = ClockStep(STILL, BEGIN, BEGIN)

    @property
    def now(self) -> float:
        """Seconds of the clock, bit-identical to those of a message's stamp."""
        whole, rest = divmod(self.step.end, NANOSECONDS)
        return whole + rest * 1e-9

    def notify(self) -> None:
        """Notify the stepper of an incoming message."""
        with self._answered:
            self._answered.notify()

    def carry_out(self, command: DriveCommand, seconds: float) -> float:
        """Execute a command in at least `seconds`; the distance not driven in metres."""
        driver = self._driver
        self._catch_up()
        # Without a deviation, the command's own velocities lead exactly to its end. Otherwise the
        # driver steers by odometry.
        exact = is_rounding(driver.offset)
        # The phases take the time of the command themselves, so the driver needs no minimum
        # duration.
        driver.begin(command, 0.0 if exact else seconds, self.now)
        if exact:
            for velocity, lasts in phases(command, seconds, driver.limits):
                self._advance(velocity, lasts)
        while (state := driver.state(self.now)) is not State.DONE:
            if state is State.BLOCKED:
                return driver.give_up()
            self._advance(driver.velocity(self.now) or STILL, _STEP_NANOSECONDS)
        return 0.0

    def _catch_up(self) -> None:
        """The robot's time may be ahead because of a predecessor's clock."""
        ahead = round(self._driver.track.latest * NANOSECONDS)
        if ahead > self.step.end:
            self.step = ClockStep(STILL, ahead, ahead)

    def _advance(self, velocity: Velocity, lasts: int) -> None:
        """Advance the clock, and wait until the robot has reported its state at that time."""
        self.step = ClockStep(velocity, self.step.end, self.step.end + lasts)
        self._wake()
        logged, since = False, time.monotonic()
        with self._answered:
            # Waits without limit: a slow simulator is not a failure.
            while not self._answered.wait_for(lambda: self._measured() >= self.now, _SILENT_AFTER):
                if not logged and time.monotonic() - since >= _SILENT_AFTER:
                    logged = True
                    log(f"no response from {self._where} to clock time {self.now:.3f} s; waiting")
        if logged:
            log(f"{self._where} responds again")


def phases(
    command: DriveCommand, seconds: float, limits: MotorLimits
) -> Iterator[tuple[Velocity, int]]:
    """The constant velocities of a command with durations in nanoseconds: turn, then drive.

    Together they last `seconds`, or longer if the limits of speed and turn require it.
    """
    turn = abs(command.turn_deg) / limits.turn
    drive = abs(command.forward_m) / limits.speed
    spare = max(0.0, seconds - turn - drive)
    busy = bool(command.turn_deg) + bool(command.forward_m)
    if command.turn_deg:
        lasts = _nanoseconds(turn + spare / busy)
        # From the rounded duration, so that velocity times duration is the commanded turn.
        yield Velocity(turn=command.turn_deg / (lasts / NANOSECONDS)), lasts
    if command.forward_m:
        lasts = _nanoseconds(drive + spare / busy)
        yield Velocity(speed=command.forward_m / (lasts / NANOSECONDS)), lasts
    if not busy:
        yield STILL, _nanoseconds(seconds)


def is_rounding(pose: Pose) -> bool:
    """True if a deviation is only rounding."""
    return portable.hypot(pose.x, pose.y) < ROUNDING and abs(pose.angle) < ROUNDING


def _nanoseconds(seconds: float) -> int:
    # Rounded up, because a shorter phase would exceed the limits of the motors.
    return max(1, math.ceil(seconds * NANOSECONDS))


_MAX_READINGS: Final = 8
"""Number of buffered scans and sightings; the newest counts."""

_EMPTY: Final = "scans without a hit"

_Timed = TypeVar("_Timed", Scan, Sightings)


class SensorBuffers(Counting):
    """The latest scans and sightings of one robot, filled by Zenoh's threads.

    `moved(time, pose)` receives odometry, and `measured(sensor, fault, mark)` readings of
    others: the fault of one, or an empty text, and a mark that no two of a sensor share.
    Without odometry the robot's clock is of no use, so readings carry their time of arrival.
    `notify()` is called after each message.
    """

    def __init__(
        self,
        base: str,
        mount: Mount | None,
        moved: Callable[[float, Pose], None],
        measured: Callable[[str, str, object], None],
        notify: Callable[[], None] = lambda: None,
        time_offset: float = 0.0,
    ) -> None:
        super().__init__()
        self._time_offset = time_offset
        self._notify = notify
        self.odometry_frame = "odom"
        self._moved, self._measured, self._frames = moved, measured, Frames()
        self._conversion = Conversion("", LivePlaces(self._frames, base, mount))
        self._clocks = ClockWatch()
        self._by_arrival = True
        self._scans = deque[Scan](maxlen=_MAX_READINGS)
        self._sightings = deque[Sightings](maxlen=_MAX_READINGS)

    def listen(self, session: Ros2Session, uses: Sequence[TopicUse]) -> None:
        """Subscribe to the configured topics."""
        takes: dict[str, Callable[[Any], None]] = {
            TRANSFORMS: self._frames.update, ODOMETRY: self._take_odometry,
            LASER_SCAN: self._take_scan, DETECTIONS: self._take_detections,
        }  # fmt: skip
        self._by_arrival = not any(use.message == ODOMETRY for use in uses)
        for use in uses:
            if use.option.startswith(WATCH):
                watched = partial(self._measured, use.option.removeprefix(WATCH), "")
                session.subscribe(use.topic, use.message, watched, use.qos)
            elif not use.sends:
                receive = self._decoder(use.message, takes[use.message])
                session.subscribe(use.topic, use.message, receive, use.qos)

    @property
    def scans(self) -> tuple[Scan, ...]:
        """The buffered scans."""
        with self._lock:
            return tuple(self._scans)

    @property
    def sightings(self) -> tuple[Sightings, ...]:
        """The buffered sightings."""
        with self._lock:
            return tuple(self._sightings)

    def measured(self, *, scan: bool, detections: bool) -> float:
        """The time up to which all requested kinds have arrived."""
        with self._lock:
            times = [
                waiting[-1].time if waiting else -math.inf
                for wanted, waiting in ((scan, self._scans), (detections, self._sightings))
                if wanted
            ]
        return min(times, default=math.inf)

    def _decoder(self, message: str, take: Callable[[Any], None]) -> Callable[[bytes], None]:
        def receive(data: bytes) -> None:
            try:
                take(messages().decode(message, data))
            except UnplacedError:
                self.count("without a transform")
            except GarbageError as error:
                self.pass_over("garbage", f"a {message} skipped: {error}")
            self._notify()

        return receive

    def _take_odometry(self, message: Any) -> None:
        pose, stamp = Pose(*readings.place_of(message.pose.pose)), readings.stamp_of(message)
        self.odometry_frame = message.header.frame_id or "odom"
        self._check_clock("odometry", stamp, message)
        self._moved(stamp, pose)

    def _take_scan(self, message: Any) -> None:
        scan = self._timed(cast("Scan", self._conversion.reading(LASER_SCAN, message)))
        scan = replace(scan, time=scan.time + self._time_offset)
        with self._lock:
            self._scans.append(scan)
        measured = scan.ranges[scan.ranges > 0]
        if measured.size and not (measured < scan.range_max).any():
            self.pass_over(
                _EMPTY,
                f"a scan shows nothing within {scan.range_max:g} m: if that cannot be, its laser is"
                " covered or broken",
            )
        fault, stamp = "" if measured.size else "without a valid range", readings.stamp_of(message)
        self._check_clock("scan", stamp, message)
        self._measured("scan", fault, stamp)

    def _take_detections(self, message: Any) -> None:
        sightings = self._timed(cast("Sightings", self._conversion.reading(DETECTIONS, message)))
        with self._lock:
            self._sightings.append(sightings)
        self._measured("detections", "", readings.stamp_of(message))

    def _check_clock(self, topic: str, stamp: float, message: Any) -> None:
        for what, line in self._clocks.problems(topic, stamp, message.header.frame_id):
            self.pass_over(what, line)

    def _timed(self, reading: _Timed) -> _Timed:
        return replace(reading, time=time.monotonic()) if self._by_arrival else reading


def seen_from(shift: Pose, sightings: Sightings, robot: str) -> Sightings:
    """Sightings made by a robot at `shift`, transformed to the origin."""
    seen = [
        replace(
            sighting,
            distance=portable.hypot(at.x, at.y),
            angle=math.degrees(portable.atan2(at.y, at.x)),
        )
        for sighting in sightings.seen
        for at in (shift.compose(Pose(angle=sighting.angle)).compose(Pose(x=sighting.distance)),)
    ]
    return Sightings(robot, tuple(seen), sightings.time)


def scanned_from(shift: Pose, scan: Scan, robot: str) -> Scan:
    """A scan made by a robot at `shift`, as one from the origin with another mount."""
    mount = shift.compose(Pose(scan.mount_x, scan.mount_y, scan.mount_angle))
    # Displacements are relative to the robot, so those of a shifted robot are conjugated by the
    # shift.
    back = shift.seen(Pose())
    path = [shift.compose(Pose(place.x, place.y, place.angle)).compose(back) for place in scan.path]
    moved = [
        Displacement(before.seconds, place.x, place.y, place.angle)
        for before, place in zip(scan.path, path, strict=True)
    ]
    return replace(
        scan,
        robot=robot,
        mount_x=mount.x,
        mount_y=mount.y,
        mount_angle=mount.angle,
        path=tuple(moved),
    )


class ReadingPublisher:
    """Publishes the newest scan and the newest sightings, each once."""

    def __init__(self, driver: Driver, senses: SensorBuffers) -> None:
        self._driver, self._senses = driver, senses
        self._published_at = {"scan": -math.inf, "sightings": -math.inf}

    def publish(self, tick: Tick, robot: str) -> None:
        """Publish new readings of this tick."""
        scan = self._newest("scan", self._senses.scans)
        if isinstance(scan, Scan):
            scan = self._driver.track.corrected(scan)
            tick.publish("scan", scanned_from(self._shift(scan.time), scan, robot))
        seen = self._newest("sightings", self._senses.sightings)
        if isinstance(seen, Sightings):
            tick.publish("sightings", seen_from(self._shift(seen.time), seen, robot))

    def _newest(self, what: str, waiting: Sequence[Scan | Sightings]) -> Scan | Sightings | None:
        """The newest reading covered by odometry, otherwise the newest.

        None if already published.
        """
        track = self._driver.track
        covered = [reading for reading in waiting if all(map(track.covers, _span(reading)))]
        if waiting and not covered:
            self._senses.count(f"{what} beside odometry's time")
        newest = (covered or waiting or [None])[-1]
        if newest is None or newest.time == self._published_at[what]:
            self._senses.count(f"frames without {what}")
            return None
        self._published_at[what] = newest.time
        return newest

    def _shift(self, at: float) -> Pose:
        """The robot's pose at a time, relative to where the string has it."""
        track, goal = self._driver.track, self._driver.goal
        pose = track.at(at) if track.covers(at) else track.newest
        shift = Pose() if pose is None or goal is None else goal.seen(pose)
        # An exact zero keeps the readings of a stepped simulation bit-identical to those of
        # physics.
        return Pose() if is_rounding(shift) else shift


def _span(reading: Scan | Sightings) -> tuple[float, float]:
    """Times of the first and last measurement."""
    return span(reading) if isinstance(reading, Scan) else (reading.time, reading.time)


class Motors:
    """Publishes on the configured topics; publishes nothing before `declare`.

    `stamped`: velocities are TwistStamped messages in the frame `base`. `map_frame` is the frame in
    which transforms place the odometry frame.
    """

    def __init__(self, map_frame: str, base: str, *, stamped: bool):
        self._map_frame, self._base, self._stamped = map_frame, base, stamped
        self._wheels: TopicPublisher | None = None
        self._clock: TopicPublisher | None = None
        self._transforms: TopicPublisher | None = None

    def declare(self, session: Ros2Session, uses: Sequence[TopicUse]) -> None:
        """Create the publishers of a session. Raises SourceError if it is lost."""
        if self._map_frame:
            self._transforms = session.publisher(session.network.tf, types.TRANSFORMS)
        publishers = {
            use.option: session.publisher(use.topic, use.message, use.qos)
            for use in uses
            if use.sends
        }
        self._clock, self._wheels = publishers.get("clock"), publishers.get("cmd_vel")

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
