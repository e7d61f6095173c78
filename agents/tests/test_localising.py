"""Localization by laser keeps the believed pose accurate; without it, the pose drifts."""

import math
from functools import cache
from typing import Any

import numpy as np
import pytest
from drifting import House

from minerva_agents.robot.grid import mark_scan
from minerva_agents.robot.matching import Uncertainty, match
from minerva_agents.robot.pose import GridPose
from minerva_agents.robot.robot import ALocalisingRobot, ARobot
from minerva_agents.robot.vocabulary import eDecide, eLaser
from minerva_agents.robot.world import scene
from minerva_bus import Frame, evolve
from minerva_bus.grammar.scene import agents

ERRORS = {"alpha1": 0.05, "alpha2": 0.02, "alpha3": 0.05, "alpha4": 0.01}
HERE = GridPose(60.3, 52.8, 20.7)
CELL = 0.05


@cache
def driven(localise, seed=1, frames=120):
    return House(localise, seed, beams=90, **ERRORS).run(frames)


def room_seen_from(pose, beams=180) -> Any:
    """Distances in cells to the walls of a room of 80 x 100 cells with a pillar, and angles."""
    angle = np.arange(beams) * 2.0 - 180.0
    heading = np.radians(angle + pose.angle)
    down, right = np.cos(heading), np.sin(heading)
    with np.errstate(divide="ignore"):
        rows = np.where(down > 0, (100.5 - pose.row) / down, (20.5 - pose.row) / down)
        columns = np.where(right > 0, (110.5 - pose.column) / right, (10.5 - pose.column) / right)
    along = (80 - pose.row) * down + (30 - pose.column) * right
    aside = (80 - pose.row) ** 2 + (30 - pose.column) ** 2 - along**2
    pillar = np.where(
        (along > 0) & (aside < 36), along - np.sqrt(np.maximum(36 - aside, 0)), np.inf
    )
    return np.minimum(np.minimum(rows, columns), pillar), angle


def room_drawn(*poses):
    grid = np.zeros((130, 130), np.int16)
    for pose in poses:
        for dist, angle in zip(*room_seen_from(pose), strict=True):
            heading = math.radians(pose.angle + angle)
            to = pose.row + dist * math.cos(heading), pose.column + dist * math.sin(heading)
            mark_scan(grid, pose.row, pose.column, *np.array([to]).T)
    return grid


DRAWN = room_drawn(HERE, GridPose(55.1, 50.2, 22.3))


@pytest.mark.parametrize("off", [(0, 0, 0), (3.2, -2.1, 4.0), (-4.0, 3.0, -7.5), (0.4, 5.5, 2.2)])
def test_a_wrong_guess_is_put_right(off):
    guess = GridPose(HERE.row + off[0], HERE.column + off[1], HERE.angle + off[2])
    pose = match(DRAWN, guess, room_seen_from(HERE), CELL, Uncertainty(0.15, 4.0))
    assert math.dist(pose.position, HERE.position) < 0.8
    assert pose.angle == pytest.approx(HERE.angle, abs=0.6)


def test_a_guess_is_kept_where_nothing_fits():
    guess = GridPose(60.0, 52.0, 20.0)
    assert (
        match(np.zeros_like(DRAWN), guess, room_seen_from(HERE), CELL, Uncertainty(0.2, 5)) is guess
    )
    dist, angle = room_seen_from(HERE)
    assert match(DRAWN, guess, (dist[:5], angle[:5]), CELL, Uncertainty(0.2, 5)) is guess


def test_it_may_look_beyond_the_grid():
    guess = GridPose(2.0, 3.0, 0.0)
    hits = np.full(40, 30.0), np.linspace(-180, 171, 40)
    pose = match(DRAWN, guess, hits, CELL, Uncertainty(0.1, 2))
    assert math.dist(pose.position, guess.position) < 10


def test_doubt_grows_with_the_move():
    still, turned, driven_far = (Uncertainty.after(*move) for move in ((0, 0), (30, 0), (0, 1)))
    assert still.metres < turned.metres < driven_far.metres
    assert still.degrees < driven_far.degrees
    assert still.degrees < turned.degrees


def test_by_its_wheels_alone_it_drifts():
    errors = np.array(driven("odometry").errors)
    assert errors[-20:, 0].mean() > 0.2


def test_by_its_laser_it_does_not():
    by_wheels, by_laser = (np.array(driven(way).errors) for way in ("odometry", "matching"))
    assert by_laser[:, 0].mean() < 0.12
    assert by_laser[-20:, 0].mean() < by_wheels[-20:, 0].mean() / 2
    assert by_laser[-20:, 1].mean() < by_wheels[-20:, 1].mean() / 2


def test_the_same_seed_gives_the_same_robot():
    first, again, other = (
        House("matching", seed, beams=40, **ERRORS).run(25).scene.digest for seed in (3, 3, 4)
    )
    assert first == again != other


def test_a_scan_is_drawn_after_the_decision():
    node = next(agent for agent in agents(scene({"localise": "matching"})) if agent.id == "r1")
    robot = ALocalisingRobot.thaw(node)
    lasers = [eLaser(1.0 + 0.02 * number, 4.0 * number) for number in range(20)]
    done = evolve(robot.string, [*lasers, eDecide()], [ALocalisingRobot], Frame(1))
    (after,) = agents(done.scene)
    usual = ARobot("r1", **{name: robot.__dict__[name] for name in ARobot.kind.fields.names})
    (drawn,) = agents(evolve(usual.string, [*lasers, eDecide()], [ARobot], Frame(1)).scene)
    assert ALocalisingRobot.thaw(after).grid.any()
    assert np.array_equal(ALocalisingRobot.thaw(after).grid, ARobot.thaw(drawn).grid)
