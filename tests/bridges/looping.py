"""A robot that drives around a block of corridors with odometry that drifts."""

import math
from itertools import pairwise

import numpy as np

from minerva_bus.log.recordings import Recorded
from minerva_bus.world.readings import Odometry, Scan

WIDE = 2.0
"""Width of the corridors in metres."""


def _outline(x0, y0, x1, y1, outwards, chance):
    """Wall segments of a rectangle with niches, shape (n, 4)."""
    corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)]
    normals = [(0, -1), (1, 0), (0, 1), (-1, 0)]
    points = []
    for begin, end, normal in zip(corners, corners[1:], normals, strict=False):
        begin, end = np.array(begin, float), np.array(end, float)
        along, aside = (
            (end - begin) / np.linalg.norm(end - begin),
            0.3 * outwards * np.array(normal),
        )
        at = 3.0
        points.append(begin)
        while at < np.linalg.norm(end - begin) - 3.0:
            niche = begin + at * along
            points += [niche, niche + aside, niche + along + aside, niche + along]
            at += chance.choice([4.0, 5.0, 7.0])
    points.append(np.array(corners[0], float))
    return np.array([(*a, *b) for a, b in pairwise(points)])


class Block:
    """Corridors around a block of `x` by `y` metres."""

    def __init__(self, x, y, seed=1):
        self.chance = np.random.default_rng(seed)
        outer = _outline(0, 0, x, y, 1, self.chance)
        inner = _outline(WIDE, WIDE, x - WIDE, y - WIDE, -1, self.chance)
        self.walls, self.x, self.y = np.concatenate([outer, inner]), x, y

    def ranges(self, x, y, heading, beams=180, most=10.0):
        """Ranges of a 360-degree laser scan at a pose."""
        angle = heading + np.arange(beams) * 2 * np.pi / beams
        cos, sin = np.cos(angle)[:, None], np.sin(angle)[:, None]
        begin_x, begin_y, end_x, end_y = self.walls.T
        wide, high, off_x, off_y = end_x - begin_x, end_y - begin_y, begin_x - x, begin_y - y
        with np.errstate(divide="ignore", invalid="ignore"):
            cross = cos * high - sin * wide
            dist = (off_x * high - off_y * wide) / cross
            part = (off_x * sin - off_y * cos) / cross
        dist = np.where((dist > 0) & (part >= 0) & (part <= 1), dist, np.inf).min(axis=1)
        dist += self.chance.normal(0.0, 0.01, beams)
        return np.where(dist < most, dist, 0.0).astype(np.float32)

    def way(self, laps):
        """Poses (x, y, radians) of a drive along the centre line of the corridors."""
        middle = WIDE / 2
        corners = [(middle, middle), (self.x - middle, middle)]
        corners += [(self.x - middle, self.y - middle), (middle, self.y - middle)]
        x, y, heading, goal, left = (
            middle + 2,
            middle,
            0.0,
            1,
            laps * 2 * (self.x + self.y - 2 * WIDE),
        )
        while left > 0:
            to_x, to_y = corners[goal % 4]
            wanted = math.atan2(to_y - y, to_x - x)
            turn = math.remainder(wanted - heading, math.tau)
            if abs(turn) > math.radians(1):
                heading += max(-math.radians(20), min(math.radians(20), turn))
            else:
                step = min(0.4, math.hypot(to_x - x, to_y - y))
                x, y, left = x + step * math.cos(wanted), y + step * math.sin(wanted), left - step
                goal += math.hypot(to_x - x, to_y - y) < 1e-6
            yield x, y, heading


def recorded(block, laps=1.2, longer=1.05, veers=0.5):
    """A recording with true poses and odometry that drifts.

    Args:
        block: the corridors.
        laps: length of the drive, in laps.
        longer: ratio of measured to true distances.
        veers: heading error of the wheels, in degrees per metre.

    """
    made, before = [], None
    for number, (x, y, heading) in enumerate(block.way(laps)):
        if before is None:
            wheels_x, wheels_y, wheels = x, y, heading
        else:
            step = longer * math.hypot(x - before[0], y - before[1])
            wheels += math.remainder(heading - before[2], math.tau) + math.radians(veers) * step
            wheels_x, wheels_y = (
                wheels_x + step * math.cos(wheels),
                wheels_y + step * math.sin(wheels),
            )
        before, time = (x, y, heading), number * 0.5
        odometry = wheels_x, wheels_y, math.degrees(wheels), 0.0, 0.0, time
        made.append(Recorded(time, "odometry", Odometry("r1", *odometry)))
        true = Odometry("r1", x, y, math.degrees(heading), 0.0, 0.0, time)
        made.append(Recorded(time, "pose", true))
        scan = Scan("r1", block.ranges(x, y, heading), 0.0, 2.0, 10.0, time)
        made.append(Recorded(time, "scan", scan))
    return made
