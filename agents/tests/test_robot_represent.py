"""θ of the robot: eRepresent executes its action, ePicture shows its knowledge."""

import numpy as np
import pytest
from robot_steps import robot

from minerva_agents.robot.grid import MARKER
from minerva_agents.robot.pose import Move, action_of
from minerva_agents.robot.robot import ARobot
from minerva_agents.robot.vocabulary import ePicture, eRepresent
from minerva_agents.robot.world import vocabulary
from minerva_bus import visualize

PLACE = {"row": 20.0, "column": 20.0, "x0": -1.0, "y0": 3.0, "angle": 30.0}


def shown(event, **state):
    scene = visualize(robot(**state), [event], [ARobot])
    vocabulary.check(scene)
    return scene


def test_the_action_is_carried_out_where_the_robot_is():
    action = action_of(Move(10.0, 0.5), "r", 0.2)
    assert str(shown(eRepresent(), action=action, **PLACE)) == (
        "TPlace<x=1, y=5, angle=30>"
        '(TRotate<angle=10>(TMove<dist=0.5>(PRobot<name="r", radius=0.2>)))'
    )


def test_a_robot_that_stays_is_the_primitive_alone():
    action = action_of(Move(), "r", 0.2)
    assert str(shown(eRepresent(), row=20, column=20, action=action)) == (
        'TPlace<x=2, y=2, angle=0>(PRobot<name="r", radius=0.2>)'
    )


def test_before_its_first_decision_there_is_nothing_to_carry_out():
    assert str(shown(eRepresent(), row=20, column=20)) == "TPlace<x=2, y=2, angle=0>()"


def test_the_picture_shows_what_it_knows_its_way_and_its_goal():
    grid = np.zeros((40, 40), np.int16)
    grid[30, 20] = MARKER + 1
    state = {"objective": "store", "plan_rows": (30.0,), "plan_columns": (20.0,)}
    picture = shown(ePicture(), grid=grid, **state, **PLACE)
    assert [node.symbol for node in picture] == ["PGrid", "PPath", "PObjective", "TPlace", "TPlace"]
    known, way, objective, goal, itself = picture
    assert objective.parameters["marker"] == "store"
    assert known.parameters["cells"] is not None
    assert (known.parameters["x"], known.parameters["y"]) == (-1.0, 3.0)
    assert way.parameters["xs"] == (1.0, 2.0)
    assert way.parameters["ys"] == (5.0, 5.0)
    assert (goal.parameters["x"], goal.scope.nodes[0].symbol) == (pytest.approx(2.05), "PGoal")
    assert (itself.parameters["x"], itself.scope.nodes[0].symbol) == (1.0, "PRobot")


def test_an_objective_that_has_not_been_seen_is_marked_by_its_name_only():
    picture = shown(ePicture(), objective="attic", **PLACE)
    assert [node.symbol for node in picture] == ["PGrid", "PObjective", "TPlace"]


def test_without_plan_and_goal_the_picture_has_neither():
    assert [node.symbol for node in shown(ePicture())] == ["PGrid", "TPlace"]
