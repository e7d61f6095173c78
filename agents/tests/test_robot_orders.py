"""λ for eObjective, eSpeed, eCollision and for all other events, 4.2.3 and section 5."""

import numpy as np
import pytest
from robot_steps import PAPER, after, changed, robot

from minerva_agents.robot.vocabulary import eCollision, eObjective, eReached, eSpeed
from minerva_bus import EventType


def test_an_objective_is_set():
    scene = robot(objective="kitchen")
    now = after(scene, eObjective("store"))
    assert now.objective == "store"
    assert changed(scene, now) == ["objective"]


def test_a_speed_is_set():
    scene = robot(speed=0.5)
    now = after(scene, eSpeed(0.75))
    assert now.speed == 0.75
    assert changed(scene, now) == ["speed"]


@pytest.mark.parametrize("event", [eReached("store"), EventType("eRain")()])
def test_otherwise_the_robot_stays_the_very_same(event):
    scene = robot(speed=0.5, objective="store")
    assert after(scene, event).string.nodes[0] is scene.nodes[0]


def test_a_collision_takes_back_what_was_not_driven():
    now = after(robot(angle=90.0), eCollision(0.05))
    assert (now.row, now.column, now.angle) == (20.5, pytest.approx(20.0), 90.0)


def test_a_collision_is_remembered_and_the_plan_forgotten():
    scene = robot(plan_rows=(30.5,), plan_columns=(20.5,), purpose="search")
    now = after(scene, eCollision(0.0))
    assert np.argwhere(now.grid).tolist() == [[22, 20]]
    assert now.way == []
    assert [name for name in changed(scene, now) if name in PAPER] == ["grid"]
