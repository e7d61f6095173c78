"""History of odometry poses."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import deque
from dataclasses import replace
from typing import Final

from minerva_bus import portable
from minerva_bus.semantics.poses import Pose
from minerva_bus.world.readings import Scan
from minerva_bus.world.recordings import needs_path, path_of

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
