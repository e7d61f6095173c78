"""A robot in the middle of a small grid, and single frames of it."""

import numpy as np

from minerva_agents.robot.robot import ARobot
from minerva_bus import Frame, evolve
from minerva_bus.grammar.scene import agents

PAPER = ("grid", "row", "column", "angle", "speed", "objective", "action")


def robot(grid=None, **state):
    """The string of one robot, `#r`; by default in cell (20, 20) of an empty grid."""
    given = {
        "grid": np.zeros((40, 40), np.int16) if grid is None else grid,
        "row": 20.5,
        "column": 20.5,
        "markers": ("kitchen", "store"),
    }
    return ARobot("r", **(given | state)).string


def after(scene, *events, frame=1, dt=0.1, seed=0):
    """The robot, thawed, after a frame with these events."""
    evolved = evolve(scene, events, [ARobot], Frame(frame, dt, seed)).scene
    (node,) = agents(evolved)
    return ARobot.thaw(node)


def emitted(scene, *events):
    """The events that the robot emits in a frame with these events."""
    return evolve(scene, events, [ARobot], Frame(1)).emitted.get("r", ())


def changed(before, robot):
    """The sorted names of the attributes that differ between a string and a robot."""
    (node,) = agents(before)
    state = robot.string.nodes[0].state
    return sorted(name for name in state if not same(state[name], node.state[name]))


def same(left, other):
    if isinstance(left, np.ndarray):
        return np.array_equal(left, other)
    return left == other
