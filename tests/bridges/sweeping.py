"""A rotating lidar on a moving robot in a room with known walls."""

import math

import numpy as np

from minerva_bus.log.recordings import Recorded
from minerva_bus.semantics.poses import Pose
from minerva_bus.world.readings import Displacement, Odometry, Scan

HALF_X, HALF_Y = 5.0, 3.0
"""Half the size of the room in metres; its centre is (0, 0)."""


def place_at(time, speed, turn, start=(-2.0, -1.0, 20.0), begin=0.0):
    """Pose on a circle of a robot with constant speed in m/s and turn rate in degrees/s."""
    x, y, angle = start
    seconds = time - begin
    after = math.radians(angle + turn * seconds)
    if abs(turn) < 1e-9:
        return Pose(
            x + speed * seconds * math.cos(after), y + speed * seconds * math.sin(after), angle
        )
    radius, before = speed / math.radians(turn), math.radians(angle)
    return Pose(
        x + radius * (math.sin(after) - math.sin(before)),
        y - radius * (math.cos(after) - math.cos(before)),
        angle + turn * seconds,
    )


def to_wall(x, y, heading):
    """Distance in metres from a point in the room to its wall along a heading in radians."""
    cos, sin = math.cos(heading), math.sin(heading)
    along = (math.copysign(HALF_X, cos) - x) / cos if cos else math.inf
    across = (math.copysign(HALF_Y, sin) - y) / sin if sin else math.inf
    return min(along, across)


def swept(time, beams, step, beam_time, place, mount=(0.0, 0.0, 0.0)):
    """A scan of a rotating lidar; `place(time)` is the pose of the robot."""
    ranges = []
    for beam in range(beams):
        at = place(time + beam * beam_time)
        turn = math.radians(at.angle)
        x = at.x + mount[0] * math.cos(turn) - mount[1] * math.sin(turn)
        y = at.y + mount[0] * math.sin(turn) + mount[1] * math.cos(turn)
        ranges.append(to_wall(x, y, math.radians(at.angle + mount[2] + beam * step)))
    x, y, angle = mount
    ranges = np.array(ranges, np.float32)
    return Scan("r1", ranges, 0.0, step, 20.0, time, x, y, angle, beam_time)


def drive(
    place, seconds=2.0, rate=50.0, beams=360, step=1.0, turn_seconds=0.2, odometry=True, **more
):
    """A recording of consecutive scans, stamped at their end, and odometry."""
    recorded = [
        Recorded(time, "odometry", Odometry("r1", at.x, at.y, at.angle, 0.0, 0.0, time))
        for time in np.arange(0.0, seconds + 0.5, 1.0 / rate).tolist()
        for at in (place(time),)
    ]
    beam_time = turn_seconds / beams
    scans = [
        Recorded(time + turn_seconds, "scan", swept(time, beams, step, beam_time, place, **more))
        for time in np.arange(0.1, seconds - turn_seconds, turn_seconds).tolist()
    ]
    kept = (recorded if odometry else []) + scans
    return sorted(kept, key=lambda recorded: recorded.stamp)


def spread(scan, at, dist, angle):
    """Root mean square distance in cm between the hits of a scan and the walls."""
    heading = np.radians(at.angle + angle)
    x, y = at.x + dist * np.cos(heading), at.y + dist * np.sin(heading)
    beside = np.minimum(np.abs(np.abs(x) - HALF_X), np.abs(np.abs(y) - HALF_Y))
    return 100 * math.sqrt(np.mean(beside**2))


def without_path(scan):
    """The scan with all its beams at one time."""
    from dataclasses import replace

    return replace(scan, path=())


__all__ = ["Displacement", "drive", "place_at", "spread", "swept", "without_path"]
