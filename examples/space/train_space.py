"""Trains robots in space: python train_space.py reach --seeds 2

The arms of reach.py reach for places, and the cars of drive.py drive to them. Those of the world
`arm` move their cups over the end of the conveyor, and the robot of `rover` explores its office.

Each robot follows a candidate of its own, as in examples/survival/train.py: the best quarter of a
generation determines the normal distribution of the next one. A policy is linear in what a robot
observes. Generation 0 acts by chance. A world with fewer robots has several episodes for each
generation.
"""

import argparse
import importlib
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from minerva_bodies import Rigid
from minerva_bodies.arm import cell
from minerva_bus.collect.data_tables import DataTable
from minerva_bus.grammar.scene import agents
from minerva_learning import parallel_env

CANDIDATES, GENERATIONS = 16, 8
CUP = 0.06
"""Metres from the flange of an arm to its cup."""
OVER = cell.TOP + 2 * cell.HALF + cell.ABOVE
"""Height of a cup over a box at the end of the conveyor, metres."""


@dataclass(frozen=True)
class Task:
    """A world, what its policies observe and do, and how well they do it."""

    name: str
    settings: Callable
    """The options of the world for a number of robots."""
    agents: str
    act: str
    observe: Any
    reward: Any
    drawn: str
    """Name of the gain, divided by `parts`, in a curve."""
    parts: float
    frames: int
    features: Callable
    trained: np.ndarray
    """Weights at the end of a training."""

    def world(self):
        """That of a module beside this one, or the name of an installed one."""
        own = self.name in ("reach", "drive")
        return importlib.import_module(self.name).world if own else self.name


def several(robots):
    return {"robots": robots}


def place_of(arm):
    """Where the cup of an arm waits for boxes, in the frame of the arm."""
    return 0.0, -cell.ARMS[arm][1], OVER


def missed(string, arm):
    """How a cup misses its place, by the pose of its flange: radians, metres, metres."""
    flange = next(node for node in agents(string) if node.id == f"{arm.id}_flange").state
    cup = Rigid(*(flange[name] for name in "xyzwijk")).then(Rigid(z=CUP))
    base, place = cell.ARMS[arm.id], place_of(arm.id)
    x, y = cup.x - base[0], cup.y - base[1]
    side = math.atan2(place[1], place[0]) - math.atan2(y, x)
    return side, math.hypot(*place[:2]) - math.hypot(x, y), place[2] - cup.z


def distance(before, arm):
    """Minus the metres from its place to where the joints of an arm move the cup."""
    first, second, third = (math.radians(angle) for angle in arm.state["goal"][:3])
    reach = cell.UPPER * math.sin(second) + cell.LOWER * math.sin(second + third)
    high = cell.SHOULDER + cell.UPPER * math.cos(second) + cell.LOWER * math.cos(second + third)
    cup = (reach * math.cos(first), reach * math.sin(first), high - cell.TOOL)
    return -math.dist(cup, place_of(arm.id))


def explored(before, robot):
    """The square metres that a robot has drawn in its map in a step."""
    known = [np.count_nonzero(state.state["grid"]) for state in (before, robot)]
    return (known[1] - known[0]) * robot.state["cell"] ** 2


TASKS = {
    "reach": Task(
        *("reach", several, "AArm", "eReach", ["side", "far", "high"]),
        *("away", "mean_distance", -80.0, 80, lambda seen: np.array([*seen, 0.1])),
        np.array(
            [[2.85, -0.65, -0.74, -1.96], [-0.32, 0.78, -3.03, -0.5], [-0.15, -1.93, -2.91, 0.95]]
        ),
    ),
    "drive": Task(
        *("drive", several, "ACar", "eDrive", ["ahead", "aside"]),
        *("gained", "metres_nearer", 1.0, 120),
        lambda seen: np.array([*seen, 0.3]) / (0.3 + np.hypot(*seen)),
        np.array([[1.37, -2.98, -0.0], [3.2, 1.4, -1.58]]),
    ),
    "arm": Task(
        *("arm", lambda _: {"boxes": 1}, "AController", "eTurn", missed),
        *(distance, "mean_distance", -80.0, 80, lambda seen: np.array([*seen, 0.1])),
        np.array(
            [[4.38, -0.44, -1.03, -0.76], [-0.36, 1.59, -1.67, 0.26], [0.81, -1.85, -1.25, -0.28]]
        ),
    ),
    "rover": Task(
        *("rover", lambda _: {"driver": "policy"}, "ADrivenRobot", "eDrive", ["near"]),
        *(explored, "square_metres", 1.0, 150, lambda seen: np.array([*(seen / 2), 1.0])),
        np.array([[1.78, -1.73, 0.84, -1.61, 1.16, -0.76], [3.97, 1.78, 1.0, -0.76, 0.74, 1.54]]),
    ),
}


def environment(task, robots, frames=0):
    return parallel_env(
        *(task.world(), task.agents, task.act, task.observe, task.reward),
        frames=frames or task.frames,
        **task.settings(robots),
    )


def space_of(env):
    """The space of the actions."""
    return env.action_space(env.possible_agents[0])


def by_chance(env, seed):
    """A policy that acts by chance."""
    random, space = np.random.default_rng(seed), space_of(env)
    return lambda _: random.uniform(space.low, space.high)


def linear(task, env, weights):
    """A policy with a row of weights for each number of the action."""
    low, high = space_of(env).low, space_of(env).high
    middle, half = (low + high) / 2, (high - low) / 2
    return lambda seen: middle + half * np.tanh(weights @ task.features(seen))


def episode(env, policies, seed):
    """What each robot of a world gains with its policy, shape (n,)."""
    observations, _ = env.reset(seed=seed)
    policies = dict(zip(env.agents, policies, strict=True))
    gained = dict.fromkeys(policies, 0.0)
    while env.agents:
        actions = {name: policies[name](observations[name]) for name in env.agents}
        observations, rewards, *_ = env.step(actions)
        for name, reward in rewards.items():
            gained[name] += reward
    return np.array([*gained.values()])


def gains_of(env, policies, seed):
    """What each policy gains, in episodes of as many as there are robots, shape (n,)."""
    size = len(env.possible_agents)
    parts = [policies[at : at + size] for at in range(0, len(policies), size)]
    return np.concatenate([episode(env, part, seed) for part in parts])


def train(task, seed=0, generations=GENERATIONS):
    """The mean weights after the last generation, and the gain of each, from that by chance."""
    random, env = np.random.default_rng(seed), environment(task, CANDIDATES)
    gains = [gains_of(env, [by_chance(env, seed)] * CANDIDATES, seed)]
    shape = (*space_of(env).shape, task.trained.shape[1])
    mean, spread = np.zeros(shape), np.full(shape, 2.0)
    for _ in range(generations):
        weights = mean + spread * random.normal(size=(CANDIDATES, *shape))
        policies = [linear(task, env, each) for each in weights]
        gains.append(gains_of(env, policies, seed=int(random.integers(1 << 31))))
        best = weights[np.argsort(-gains[-1], kind="stable")[: CANDIDATES // 4]]
        mean, spread = best.mean(axis=0), best.std(axis=0) + 0.1
    env.close()
    return mean, np.mean(gains, axis=1) / task.parts


def curves(task, seeds, generations):
    """The gains of several trainings, as a table."""
    runs = [train(task, seed, generations)[1] for seed in range(seeds)]
    seed, generation = np.indices((seeds, generations + 1)).reshape(2, -1)
    types = {"seed": "int64", "generation": "int64", task.drawn: "float64"}
    columns = {"seed": seed, "generation": generation, task.drawn: np.concatenate(runs)}
    return DataTable(task.name, types, columns)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("task", choices=list(TASKS))
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--generations", type=int, default=GENERATIONS)
    parser.add_argument("--plot", default="", help="a picture of the curve, such as curve.png")
    given = parser.parse_args()
    task = TASKS[given.task]
    table = curves(task, given.seeds, given.generations)
    for number in range(given.generations + 1):
        print(number, table[task.drawn][table["generation"] == number].round(2).tolist())
    if given.plot:
        table.plot(task.drawn, x="generation").save(given.plot)
