"""The picture of a world's latest views, with the status line and the beams of buffered scans."""

from __future__ import annotations

from collections import deque

import numpy as np

from minerva_bus.semantics.picture import Picture
from minerva_bus.semantics.poses import Pose
from minerva_bus.world.beams import origins
from minerva_bus.world.operator import WorldStatus
from minerva_bus.world.readings import Reading, Scan
from minerva_bus.world.service_inputs import View, WorldInfo
from minerva_services.views.fates import OrderEntry
from minerva_services.views.names import agent_names
from minerva_services.views.overlay import Overlay
from minerva_services.views.window.controls import WindowControls
from minerva_services.views.window.painter import Beams, Sight
from minerva_services.views.window.picking import spots_of

_MAX_SCANS = 8


class ScanBuffer:
    """The latest scans of each robot."""

    def __init__(self) -> None:
        self._scans: dict[str, deque[Scan]] = {}

    def add(self, reading: Reading) -> None:
        """Add a reading; readings other than scans are ignored."""
        if isinstance(reading, Scan):
            self._scans.setdefault(reading.robot, deque(maxlen=_MAX_SCANS)).append(reading)

    def beams(self, picture: Picture, time: float) -> list[Beams]:
        """The beams of all robots in a picture of this simulated time."""
        spots = spots_of(picture, self._scans.keys())
        return [
            beams_of(_of_time(self._scans[robot], time), Pose(spot.x, spot.y, spot.angle))
            for robot, spot in spots.items()
        ]


def _of_time(scans: deque[Scan], time: float) -> Scan:
    """The newest scan not newer than the picture, or the oldest: real sensors have other clocks."""
    return next((scan for scan in reversed(scans) if scan.time <= time + 1e-6), scans[-1])


def beams_of(scan: Scan, robot: Pose) -> Beams:
    """The beams of a scan, relative to the robot's displayed pose."""
    sensor = robot.then(scan.mount_x, scan.mount_y, scan.mount_angle, 0.0)
    x, y, degrees = origins(scan, np.arange(len(scan.ranges)))
    ranges = np.asarray(scan.ranges, np.float64)
    hits = ranges < scan.range_max  # False for NaN, too
    ranges = np.where(hits, ranges, scan.range_max)
    angle, turn = np.radians(degrees + robot.angle), np.radians(robot.angle)
    begin_x = robot.x + x * np.cos(turn) - y * np.sin(turn)
    begin_y = robot.y + x * np.sin(turn) + y * np.cos(turn)
    ends = np.stack([begin_x + ranges * np.cos(angle), begin_y + ranges * np.sin(angle)], axis=1)
    return Beams(sensor.x, sensor.y, ends, hits)


_LONG_WAIT = 1.0
"""Waiting time in seconds from which it is shown; short waits are normal."""


HINT = "? shows the keys"


def caption(
    frame: int, dt: float, status: WorldStatus | None, doing: str = "", report: str = ""
) -> str:
    """Frame, time and rate; `report` and `doing` are appended."""
    parts = [f"frame {frame}", f"{frame * dt:.1f} s"] if frame >= 0 else ["no view yet"]
    if status is not None:
        parts.append("paused" if status.paused else pace(status))
        if status.waiting and status.waited > _LONG_WAIT:
            parts.append(f"waiting for {', '.join(status.waiting)}")
    return "  ·  ".join([*parts, *(text for text in (report, doing) if text)])


def pace(status: WorldStatus) -> str:
    """Frames per second, and the target rate if that is higher."""
    reached = f"{status.hz:.0f}"
    wanted = f" of {status.rate:g}" if status.rate and status.hz < 0.9 * status.rate else ""
    return f"{reached}{wanted} frames per second"


class Composer:
    """Combines the views of several event types to one picture."""

    def __init__(self, world: WorldInfo, draws: tuple[str, ...]) -> None:
        self._world = world
        self._overlay = Overlay(world.vocabulary, draws)
        self._scans = ScanBuffer()
        self.picture = Picture()

    def add_view(self, view: View) -> None:
        """Replace the view of its event type."""
        self._overlay.add(view)

    def add_reading(self, reading: Reading) -> None:
        """Keep a scan, to draw its beams."""
        self._scans.add(reading)

    def compose(
        self,
        controls: WindowControls,
        text: tuple[str, str, str],
        orders: tuple[OrderEntry, ...] = (),
        *,
        keys: bool = False,
    ) -> Sight:
        """Everything to display; `text`: title, subtitle, notice; `keys`: whether keys act."""
        self.picture = self._overlay.picture()
        time = max(self._overlay.frame, 0) * self._world.dt
        return Sight(
            self.picture,
            tuple(self._scans.beams(self.picture, time)) if controls.beams else (),
            *text,
            controls.help if controls.helps else (),
            controls.selected,
            controls.follows,
            HINT if keys and not controls.helps else "",
            self.picture.legend if controls.legend else (),
            agent_names(self.picture),
            orders if controls.orders else (),
        )

    def text(
        self, controls: WindowControls, status: WorldStatus | None, notice: str, report: str = ""
    ) -> tuple[str, str, str]:
        """Title, subtitle and notice of the current state."""
        subtitle = caption(self._overlay.frame, self._world.dt, status, controls.doing, report)
        return self._world.world, subtitle, notice
