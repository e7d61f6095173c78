"""A norm rejects a robot's step: the body stays with the robot, which finds another way."""

import math

import floor_plans
import pytest
from errands import FILE

from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.grammar.scene import agents
from minerva_bus.launch.world_files import read_world_file
from minerva_bus.runtime.runner import InProcessRunner
from minerva_bus.settings.world_settings import Overrides

STEP = 0.08
"""Metres that a robot drives per frame: between frames, w is one frame ahead of the body."""


@pytest.fixture
def hall(tmp_path):
    """A hall of 6 m x 4 m with markers, as options of the robot's world."""
    markers = {"east": [5.3, 0.8], "west": [0.7, 3.2]}
    plan = floor_plans.hall(tmp_path, start=[1.0, 1.0, 0.0], markers=markers)
    return {"map": plan, "objective": "east", "parcels": ""}


class Watched:
    """The shipped world with norms, in one process."""

    def __init__(self, folder, norms, **options):
        path = folder / "watched.toml"
        path.write_text(FILE.read_text(encoding="utf-8") + norms, encoding="utf-8")
        file = read_world_file(path, Overrides(options=options))
        self.algorithm = FrameAlgorithm(file.world)
        members = [process.make_member() for process in file.processes]
        self.physics = next(member.service for member in members if member.name == "physics")
        self.runner = InProcessRunner(self.algorithm, members, lambda message: None)
        self.runner.start()
        self.apart, self.cells = 0.0, set()

    def run(self, frames):
        while self.runner.ended is None and self.algorithm.frame < frames:
            self.runner.handle(s.Begin())
            arena = self.physics._stage.arena
            for robot in agents(self.algorithm.scene):
                if robot.id in arena.bodies:
                    self.note(robot.state, arena.pose(robot.id))
        return self

    def note(self, state, body):
        cell, x0, y0 = state["cell"], state["x0"], state["y0"]
        believed = x0 + state["row"] * cell, y0 + state["column"] * cell
        self.apart = max(self.apart, math.dist(believed, (body.x, body.y)))
        self.cells |= {(state["row"], state["column"])}
        self.cells |= {((body.x - x0) / cell, (body.y - y0) / cell)}

    @property
    def refused(self):
        return sum(self.algorithm.norms.broken.values())


@pytest.mark.parametrize(
    "event", ["", 'event = "eGivenUp"\ndata = { source = "", target = "", why = "no" }']
)
def test_the_string_and_the_body_stay_together_outside_the_zone(tmp_path, event):
    norm = f'\n[norm.nogo]\napplies = "ARobot"\nwhere = "row > 25"\n{event}'
    world = Watched(tmp_path, norm).run(150)
    assert world.refused > 2
    assert world.apart <= STEP + 1e-6
    assert max(row for row, _ in world.cells) <= 25


def test_a_robot_goes_round_what_is_forbidden(tmp_path, hall):
    """The forbidden area contains nothing that the laser can detect."""
    zone = "row > 25 and row < 35 and column < 25"
    norm = f'\n[norm.nogo]\napplies = "ARobot"\nwhere = "{zone}"\n'
    world = Watched(tmp_path, norm, **hall).run(900)
    assert world.refused
    assert world.runner.ended is not None, "it reaches the marker behind the zone"
    assert world.apart <= STEP + 1e-6
    assert not any(25 < row < 35 and column < 25 for row, column in world.cells)
