"""A robot whose planner is a function of a user."""

import numpy as np
import pytest
from robot_steps import after, robot

from minerva_agents.robot.approach import step
from minerva_agents.robot.grid import FREE, MARKER, OBSTACLE
from minerva_agents.robot.pose import STAY, action_of
from minerva_agents.robot.vocabulary import eDecide
from minerva_agents.robot.world import RobotOptions
from minerva_bus.errors import MinervaError, WorldFileError

CALLS = []


def ahead(known, moment):
    CALLS.append(known)
    return [(known.x + 1.0, known.y)] if known.clear(known.x + 1.0, known.y) else []


def nonsense(known, moment):
    return 3


def nowhere(known, moment):
    return [(float("nan"), 1.0)]


def far(known, moment):
    return [(2.0, 2.0), (1e9, 1.0)]


def alone(known):
    return []


def seeking(planner, wall=False):
    grid = np.full((40, 40), FREE, np.int16)
    grid[10, 10] = MARKER
    if wall:
        grid[26, :] = OBSTACLE
    state = {"speed": 0.5, "objective": "kitchen", "action": action_of(STAY, "r", 0.18)}
    return robot(grid, planner=f"{__name__}:{planner}", **state)


def test_the_robot_drives_along_the_way_of_the_function():
    CALLS.clear()
    now = after(seeking("ahead"), eDecide(), frame=0)
    (known,) = CALLS
    assert (known.x, known.y) == pytest.approx((2.05, 2.05))
    assert known.objective == "kitchen"
    assert known.place == pytest.approx((1.05, 1.05))
    assert known.seen(1.0, 1.0)
    assert not known.seen(9.0, 9.0)
    assert now.way == [pytest.approx((30.5, 20.5))]
    assert step(now, 0.1) != STAY
    for frame in range(1, 5):
        now = after(now.string, eDecide(), frame=frame)
    assert now.row > 20.5
    assert len(CALLS) == 1  # while the way is clear


def test_without_a_way_the_robot_waits_and_asks_again():
    CALLS.clear()
    now = after(seeking("ahead", wall=True), eDecide(), frame=0)
    now = after(now.string, eDecide(), frame=1)
    assert (now.row, now.way, len(CALLS)) == (20.5, [], 2)


def test_mistakes_are_explained():
    with pytest.raises(MinervaError, match="returned 3; expected corners in metres"):
        after(seeking("nonsense"), eDecide(), frame=0)
    with pytest.raises(MinervaError, match=r"planner .*:nowhere returned .*expected corners"):
        after(seeking("nowhere"), eDecide(), frame=0)
    with pytest.raises(MinervaError, match=r"planner .*:far returned the corner \(1e\+09, 1\)"):
        after(seeking("far"), eDecide(), frame=0)
    with pytest.raises(WorldFileError, match=r"alone: too many .* called with \(known, moment\)"):
        RobotOptions.read({"planner": f"{__name__}:alone"})
    with pytest.raises(WorldFileError, match="has no ahed; did you mean 'ahead'"):
        RobotOptions.read({"planner": f"{__name__}:ahed"})
