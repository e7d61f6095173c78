"""Trains arms to reach and cars to drive: python train_space.py reach --seeds 2

Each robot follows a candidate of its own, as in examples/survival/train.py: the best quarter of a
generation determines the normal distribution of the next one. A policy is linear in what a robot
observes. Generation 0 acts by chance.
"""

import argparse
import importlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from minerva_bus.collect.data_tables import DataTable
from minerva_learning import parallel_env

ROBOTS, GENERATIONS = 16, 8


@dataclass(frozen=True)
class Task:
    """A world, what its policies observe and do, and how well they do it."""

    name: str
    agents: str
    act: str
    most: float
    """Largest number of an action."""
    observe: list[str]
    reward: str
    drawn: str
    """Name of the gain, divided by `parts`, in a curve."""
    parts: float
    frames: int
    features: Callable
    trained: np.ndarray
    """Weights at the end of a training."""

    def world(self):
        return importlib.import_module(self.name).world


TASKS = {
    "reach": Task(
        *("reach", "AArm", "eReach", 4.0, ["side", "far", "high"]),
        *("away", "mean_distance", -80.0, 80, lambda seen: np.array([*seen, 0.1])),
        np.array(
            [[2.85, -0.65, -0.74, -1.96], [-0.32, 0.78, -3.03, -0.5], [-0.15, -1.93, -2.91, 0.95]]
        ),
    ),
    "drive": Task(
        *("drive", "ACar", "eDrive", 1.0, ["ahead", "aside"]),
        *("gained", "metres_nearer", 1.0, 120),
        lambda seen: np.array([*seen, 0.3]) / (0.3 + np.hypot(*seen)),
        np.array([[1.37, -2.98, -0.0], [3.2, 1.4, -1.58]]),
    ),
}


def environment(task, robots, frames=0):
    return parallel_env(
        *(task.world(), task.agents, task.act, task.observe, task.reward),
        frames=frames or task.frames,
        robots=robots,
    )


def by_chance(task, env, seed):
    """A policy that acts by chance."""
    random, size = np.random.default_rng(seed), env.action_space(env.possible_agents[0]).shape
    return lambda _: random.uniform(-task.most, task.most, size)


def linear(task, weights):
    """A policy with a row of weights for each number of the action."""
    return lambda seen: task.most * np.tanh(weights @ task.features(seen))


def episode(env, policies, seed):
    """What each robot gains with its policy, shape (n,)."""
    observations, _ = env.reset(seed=seed)
    policies = dict(zip(env.agents, policies, strict=True))
    gained = dict.fromkeys(policies, 0.0)
    while env.agents:
        actions = {name: policies[name](observations[name]) for name in env.agents}
        observations, rewards, *_ = env.step(actions)
        for name, reward in rewards.items():
            gained[name] += reward
    return np.array([*gained.values()])


def train(task, seed=0, generations=GENERATIONS, robots=ROBOTS):
    """The mean weights after the last generation, and the gain of each, from that by chance."""
    random, env = np.random.default_rng(seed), environment(task, robots)
    gains = [episode(env, [by_chance(task, env, seed)] * robots, seed)]
    inputs = len(task.features(np.zeros(len(task.observe))))
    mean = np.zeros((*env.action_space(env.possible_agents[0]).shape, inputs))
    spread = np.full(mean.shape, 2.0)
    for _ in range(generations):
        weights = mean + spread * random.normal(size=(robots, *mean.shape))
        policies = [linear(task, each) for each in weights]
        gains.append(episode(env, policies, seed=int(random.integers(1 << 31))))
        best = weights[np.argsort(-gains[-1], kind="stable")[: robots // 4]]
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
