"""Fast simulation of a robot on a floor: its own λ with simplified sensors and motion.

There is no bus, and no string between two frames: the measurements of laser and camera and the
effects of commands are computed directly on the true map. `--check` of
`agents.benchmarks.exploration` compares this with the complete world.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from minerva_agents.robot.control import next_move, notice
from minerva_agents.robot.grid import (
    clear_open_beam,
    clearance,
    clearing_part,
    mark_marker,
    mark_obstacle,
    mark_scan,
)
from minerva_agents.robot.maps import Marker, OccupancyMap
from minerva_agents.robot.pose import STAY, Move, at_distance, at_distances
from minerva_agents.robot.robot import ARobot
from minerva_bus import Frame
from minerva_bus.world.context import Context

Reals = NDArray[np.float64]

BEAMS, REACH, FOV, SIGHT, DT = 90, 8.0, 60.0, 5.0, 0.1


@dataclass(frozen=True, slots=True)
class Noise:
    """Error levels: range of a beam in metres, share of lost beams, relative error of motion."""

    laser: float = 0.0
    dropout: float = 0.0
    drive: float = 0.0


@dataclass(slots=True)
class Run:
    """Result of a run, in metres and seconds; `reason` is the one that the robot reported."""

    reached: bool = False
    frames: int = 0
    metres: float = 0.0
    collisions: int = 0
    reported: bool = False
    reason: str = ""
    slowest: float = 0.0
    seconds: float = 0.0


class Floor:
    """A map for ray casting and distances; all cells that are not free are solid."""

    def __init__(self, floor: OccupancyMap) -> None:
        self.side = floor.resolution
        self.solid = np.pad(floor.obstacles, 1, constant_values=True)
        self.x, self.y = floor.x - self.side, floor.y - self.side
        self._far = clearance(self.solid) * self.side
        self._steps = np.maximum(self._far - 0.71 * self.side, 0.004)
        self._steps[self.solid] = 0.0

    def cast(self, x: float, y: float, angles: Reals, longest: float) -> Reals:
        """Lengths of rays from a point at angles in degrees to the first hit, at most `longest`."""
        cos, sin = np.cos(np.radians(angles)), np.sin(np.radians(angles))
        lengths, live = np.zeros(len(angles)), np.arange(len(angles))
        while live.size:
            at = lengths[live]
            rows = ((x + at * cos[live] - self.x) / self.side).astype(np.intp)
            columns = ((y + at * sin[live] - self.y) / self.side).astype(np.intp)
            steps = self._steps[rows, columns]
            lengths[live] = at + steps
            live = live[(steps > 0) & (at + steps < longest)]
        return np.minimum(lengths, longest)

    def gap(self, x: float, y: float) -> float:
        """Distance from a point to the nearest solid cell, at most half a metre."""
        row, column = int((x - self.x) / self.side), int((y - self.y) / self.side)
        if self._far[row, column] > 0.5 + self.side:
            return 0.5
        reach = math.ceil(0.5 / self.side)
        top, left = max(0, row - reach), max(0, column - reach)
        solid = np.argwhere(self.solid[top : row + reach + 1, left : column + reach + 1])
        low = (solid + np.array([top, left])) * self.side + (self.x, self.y)
        away = np.maximum(np.maximum(low - (x, y), (x, y) - (low + self.side)), 0.0)
        return float(np.hypot(*away.T).min(initial=0.5))


class Drive:
    """A robot on its way to an objective; `robot` stays thawed between frames."""

    def __init__(
        self, floor: Floor, markers: tuple[Marker, ...], robot: ARobot, noise: Noise, seed: int
    ) -> None:
        self._floor, self._markers, self._robot, self._noise = floor, markers, robot, noise
        self._true = robot.pose
        self._chance = np.random.default_rng(seed)
        self._seed = seed
        self._move = STAY
        self.run = Run()

    def go(self, frames: int) -> Run:
        """Drive until the robot reports success or failure, at most `frames` frames."""
        run = self.run
        begin = time.perf_counter()
        while run.frames < frames and not (run.reached or run.reported):
            self._frame()
            run.frames += 1
        run.seconds = time.perf_counter() - begin
        return run

    def _frame(self) -> None:
        self._carry_out()
        robot = self._robot
        self._sense()
        moment = Context(Frame(self.run.frames, DT, self._seed), f"#{robot.id}")
        begin = time.perf_counter()
        notice(robot)
        robot.row, robot.column, robot.angle = self._believed
        self._move = next_move(robot, moment)
        self.run.slowest = max(self.run.slowest, time.perf_counter() - begin)
        for event in moment.emitted:
            self.run.reached |= event.type == "eReached"
            if event.type == "eUnreachable":
                self.run.reported, self.run.reason = True, event.why

    def _carry_out(self) -> None:
        """Execute the command on the true floor, and stop at a contact."""
        robot, move = self._robot, self._move
        cell = robot.cell
        believed = robot.pose.after(move, cell)
        driven = move.dist * (1.0 + self._noise.drive * self._chance.standard_normal())
        end, moved = self._true, 0.0
        for part in (0.25, 0.5, 0.75, 1.0):
            after = self._true.after(Move(move.turn, driven * part), cell)
            x, y = robot.metres(after.position)
            if move.dist and self._floor.gap(x, y) < robot.radius:
                self.run.collisions += 1
                believed = believed.after(Move(0.0, moved - driven), cell)
                touch = robot.radius / cell + 0.5
                mark_obstacle(robot.grid, *at_distance(*believed.position, believed.angle, touch))
                robot.forget_plan()
                break
            end, moved = after, driven * part
        self._true = end
        self.run.metres += abs(moved)
        self._believed = believed.row, believed.column, believed.angle
        robot.row, robot.column, robot.angle = self._believed

    def _sense(self) -> None:
        robot, grid = self._robot, self._robot.writable("grid")
        x, y = robot.metres(self._true.position)
        angles = np.arange(BEAMS) * (360.0 / BEAMS)
        ranges = self._floor.cast(x, y, angles + self._true.angle, REACH)
        hit = ranges < REACH
        if self._noise.laser:
            ranges = ranges + self._noise.laser * self._chance.standard_normal(BEAMS) * hit
        if self._noise.dropout:
            hit &= self._chance.random(BEAMS) >= self._noise.dropout
        part, row, column = clearing_part(self.run.frames), robot.row, robot.column
        hits = at_distances(row, column, robot.angle + angles[hit], ranges[hit] / robot.cell)
        mark_scan(grid, row, column, *hits, part)
        for angle in angles[~hit].tolist():
            to = at_distance(row, column, robot.angle + angle, REACH / robot.cell)
            clear_open_beam(grid, row, column, *to, part)
        for name, dist, angle in self._sightings(x, y):
            to = at_distance(row, column, robot.angle + angle, dist / robot.cell)
            mark_marker(grid, *to, robot.markers.index(name))

    def _sightings(self, x: float, y: float) -> Iterator[tuple[str, float, float]]:
        for marker in self._markers:
            dist = math.hypot(marker.x - x, marker.y - y)
            bearing = math.degrees(math.atan2(marker.y - y, marker.x - x))
            angle = (bearing - self._true.angle + 180.0) % 360.0 - 180.0
            if dist > SIGHT or abs(angle) > FOV / 2:
                continue
            if self._floor.cast(x, y, np.array([bearing]), dist)[0] >= dist - 0.01:
                yield marker.name, dist, angle
