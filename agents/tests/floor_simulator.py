"""A floor for tests: robots with exact motion, a laser and a camera, without a bus.

It evolves the world's string frame by frame, as in Table 2: the events of a frame are measured at
the pose that results from the actions of previous frames.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from minerva_agents.robot.grid import clearance
from minerva_agents.robot.pose import GridPose, move_of
from minerva_agents.robot.robot import ARobot
from minerva_agents.robot.vocabulary import (
    eCamera,
    eClear,
    eDecide,
    eLaser,
    eObjective,
    eRepresent,
    eSpeed,
)
from minerva_bus import Frame, evolve, visualize
from minerva_bus.grammar.scene import agents

BEAMS, LASER_RANGE = 90, 8.0
FOV, SIGHT = 60.0, 5.0


class Floor:
    """The content of a map, for rays and discs; every cell that is not free is solid."""

    def __init__(self, floor):
        self.solid = np.pad(floor.obstacles, 1, constant_values=True)
        self.side = floor.resolution
        self.x, self.y = floor.x - self.side, floor.y - self.side
        self.steps = np.maximum((clearance(self.solid) - 0.71) * self.side, 0.004)
        self.steps[self.solid] = 0.0

    def cells(self, x, y):
        rows = np.clip(((x - self.x) / self.side).astype(int), 0, self.solid.shape[0] - 1)
        columns = np.clip(((y - self.y) / self.side).astype(int), 0, self.solid.shape[1] - 1)
        return rows, columns

    def cast(self, x, y, angles, longest):
        """Distances that rays travel from a point before they hit something, at most `longest`."""
        cos, sin = np.cos(np.radians(angles)), np.sin(np.radians(angles))
        lengths = np.zeros(len(angles))
        for _ in range(2000):
            steps = self.steps[self.cells(x + lengths * cos, y + lengths * sin)]
            steps = np.where(lengths < longest, steps, 0.0)
            if not steps.any():
                break
            lengths += steps
        return np.minimum(lengths, longest)

    def gap(self, x, y):
        """The distance from a point to the nearest solid, at most half a metre."""
        reach = math.ceil(0.5 / self.side)
        row, column = (int(index) for index in self.cells(np.float64(x), np.float64(y)))
        top, left = max(0, row - reach), max(0, column - reach)
        solid = np.argwhere(self.solid[top : row + reach + 1, left : column + reach + 1])
        if not len(solid):
            return 0.5
        low = (solid + (top, left)) * self.side + (self.x, self.y)
        away = np.maximum(np.maximum(low - (x, y), (x, y) - (low + self.side)), 0.0)
        return min(0.5, float(np.hypot(*away.T).min()))


@dataclass
class Run:
    """The results of a run."""

    reached: bool = False
    frames: int = 0
    metres: float = 0.0
    least_gap: float = 0.5
    seconds: list[float] = field(default_factory=list)
    poses: list[GridPose] = field(default_factory=list)


class Simulator:
    """One robot on a floor."""

    def __init__(self, floor, markers, scene, objective, speed=0.8, seed=0, dt=0.1):
        self.floor = Floor(floor)
        self.markers = markers
        self.scene = scene
        (self.node,) = agents(scene)
        state = self.node.state
        self.cell, self.x0, self.y0 = state["cell"], state["x0"], state["y0"]
        self.pose = GridPose(state["row"], state["column"], state["angle"])
        self.first = [eSpeed(speed), eObjective(objective)]
        self.seed, self.dt = seed, dt
        self.run = Run()

    def place(self):
        return self.x0 + self.pose.row * self.cell, self.y0 + self.pose.column * self.cell

    def events(self):
        x, y = self.place()
        angles = np.arange(BEAMS) * (360.0 / BEAMS)
        ranges = self.floor.cast(x, y, angles + self.pose.angle, LASER_RANGE)
        scan = list(zip(ranges.tolist(), angles.tolist(), strict=True))
        lasers = [eLaser(dist, angle) for dist, angle in scan if dist < LASER_RANGE]
        clears = [eClear(dist, angle) for dist, angle in scan if dist >= LASER_RANGE]
        return [*lasers, *clears, *self.sightings(x, y), *self.first, eDecide()]

    def sightings(self, x, y):
        for marker in self.markers:
            dist = math.hypot(marker.x - x, marker.y - y)
            bearing = math.degrees(math.atan2(marker.y - y, marker.x - x))
            angle = (bearing - self.pose.angle + 180.0) % 360.0 - 180.0
            if dist <= SIGHT and abs(angle) <= FOV / 2:
                way = self.floor.cast(x, y, np.array([bearing]), dist)[0]
                if way >= dist - 0.01:
                    yield eCamera(marker.name, dist, angle)

    def step(self, clock=None):
        """Run one frame of Table 2; True once the robot has reported its arrival."""
        events = self.events()
        begin = clock() if clock else 0.0
        evolved = evolve(self.scene, events, [ARobot], Frame(self.run.frames, self.dt, self.seed))
        if clock:
            self.run.seconds.append(clock() - begin)
        shown = visualize(self.scene, [eRepresent()], [ARobot])
        self.carry_out(move_of(shown))
        self.scene, self.first = evolved.scene, []
        self.run.frames += 1
        return any(evolved.emitted.values())

    def carry_out(self, move):
        for part in (0.5, 1.0):
            pose = self.pose.after(type(move)(move.turn, move.dist * part), self.cell)
            x, y = self.x0 + pose.row * self.cell, self.y0 + pose.column * self.cell
            self.run.least_gap = min(self.run.least_gap, self.floor.gap(x, y))
        self.pose = pose
        self.run.metres += abs(move.dist)
        self.run.poses.append(pose)

    def go(self, frames, clock=None):
        while self.run.frames < frames and not self.run.reached:
            self.run.reached = self.step(clock)
        return self.run
