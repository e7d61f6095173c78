"""The picture of a world's latest views, with the status line and the beams of buffered scans."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from minerva_bus.runtime.operator_client import activity, awaited
from minerva_bus.semantics.poses import Pose
from minerva_bus.world.operator import WorldStatus
from minerva_bus.world.readings import Reading, Scan, origins
from minerva_bus.world.services import View, WorldInfo
from minerva_services.geometry.picture import Picture
from minerva_services.views.fates import OrderEntry
from minerva_services.views.names import agent_names
from minerva_services.views.overlay import Overlay
from minerva_services.views.window.controls import WindowControls
from minerva_services.views.window.painter import Beams, Sight
from minerva_services.views.window.picking import spots_of

_MAX_SCANS = 64
"""Scans kept for each robot, because they may arrive long before the picture of their frame."""


@dataclass(slots=True)
class _Measured:
    """A scan, the frame whose string its robot had, and its beams in the picture of that frame."""

    scan: Scan
    frame: int
    beams: Beams | None = None


class ScanBuffer:
    """The latest scans of each robot."""

    def __init__(self) -> None:
        self._scans: dict[str, deque[_Measured]] = {}

    def add(self, reading: Reading, frame: int) -> None:
        """Add a reading of a frame, -1 for the next picture's; others than scans are ignored."""
        if isinstance(reading, Scan):
            scans = self._scans.setdefault(reading.robot, deque(maxlen=_MAX_SCANS))
            scans.append(_Measured(reading, frame))

    def beams(self, picture: Picture, frame: int) -> list[Beams]:
        """The beams of all robots in the picture of a frame, where they were measured.

        The newest scan may be of an earlier frame: a lidar can be slower than the frames, and no
        scan follows the last one. Its beams stay where its own frame's picture had the robot.
        Without such a picture, nobody knows where they belong, and they are left out.
        """
        beams: list[Beams] = []
        for robot, spot in spots_of(picture, self._scans.keys()).items():
            scans = self._scans[robot]
            newest = next((each for each in reversed(scans) if each.frame <= frame), None)
            if newest is None:
                continue
            if newest.frame < 0:
                newest.frame = frame
            if newest.frame == frame:
                newest.beams = beams_of(newest.scan, Pose(spot.x, spot.y, spot.angle))
            if newest.beams is not None:
                beams.append(newest.beams)
        return beams


def beams_of(scan: Scan, robot: Pose) -> Beams:
    """The beams of a scan that a robot measured at this pose."""
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


HINT = "? shows the keys"


def caption(
    frame: int, dt: float, status: WorldStatus | None, doing: str = "", report: str = ""
) -> str:
    """Frame, time and rate; `report` and `doing` are appended."""
    parts = [f"frame {frame}", f"{frame * dt:.1f} s"] if frame >= 0 else ["no view yet"]
    if status is not None:
        parts.append("paused" if status.paused else pace(status))
        if awaited(status):
            parts.append(activity(status))
    return "  ·  ".join([*parts, *(text for text in (report, doing) if text)])


def pace(status: WorldStatus) -> str:
    """Frames per second, and the target rate if that is higher."""
    reached = f"{status.hz:.0f}"
    wanted = f" of {status.rate:g}" if status.rate and status.hz < 0.9 * status.rate else ""
    return f"{reached}{wanted} frames per second"


class Composer:
    """Combines the views of several event types to one picture."""

    def __init__(self, world: WorldInfo, draws: tuple[str, ...], space: bool = False) -> None:
        self._world = world
        self._overlay = Overlay(world, draws, space)
        self._scans = ScanBuffer()
        self.picture = Picture()

    def add_view(self, view: View) -> None:
        """Replace the view of its event type."""
        self._overlay.add(view)

    @property
    def is_complete(self) -> bool:
        """True if the views of all event types are of one frame."""
        return self._overlay.is_complete

    def add_reading(self, reading: Reading, frame: int) -> None:
        """Keep a scan of a frame, to draw its beams."""
        self._scans.add(reading, frame)

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
        return Sight(
            self.picture,
            tuple(self._scans.beams(self.picture, self._overlay.frame)) if controls.beams else (),
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
