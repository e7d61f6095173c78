"""Trains one policy for all agents of a world by PPO: python train_ppo.py survival --seeds 4"""

import argparse
from dataclasses import dataclass
from typing import Any

import corridor
import numpy as np
import survival
from ppo import learn

from minerva_bus import World
from minerva_bus.collect.table import DataTable
from minerva_bus.rl import population_env


def smell(observations):
    """The difference and the strength of the smells, and the energy, shape (n, 3)."""
    left, right, energy = observations.T
    both = left + right
    return np.stack([10 * (left - right) / (both + 1e-9), np.log(both + 0.1), energy - 2], 1)


def scan(observations):
    """The beams of the laser, and the direction, shape (n, 9)."""
    heading = np.radians(observations[:, -1:])
    beams = observations[:, :-1] / (corridor.REACH / 2) - 1
    return np.concatenate([beams, np.sin(heading), np.cos(heading)], 1)


@dataclass
class Task:
    """A world, its learners, what they observe and gain, and the name of the sum of rewards."""

    world: World
    kind: str
    observed: list[str]
    features: Any
    reward: str | None
    gained: str
    agents: dict[str, int]


BEAMS = [f"beam{number}" for number in range(len(corridor.ANGLES))]
TASKS = {
    "survival": Task(survival.world, "ARabbit", ["left", "right", "energy"], smell, None,
                     "lifetime", {"rabbits": 48}),
    "corridor": Task(corridor.world, "ARobot", [*BEAMS, "heading"], scan, "x",
                     "metres", {"robots": 48}),
}  # fmt: skip


def train(name, seed=0, updates=15, frames=300):
    """The trained policy, and the mean sum of rewards in each episode."""
    task = TASKS[name]
    envs = population_env(
        task.world, task.kind, "eSteer", task.observed, task.reward, frames=frames, **task.agents
    )
    policy, curve = learn(envs, task.features, seed, updates)
    envs.close()
    return policy, curve


def curves(name, seeds, updates):
    """The sums of rewards of several trainings, as a table."""
    gained = np.array([train(name, seed, updates)[1] for seed in range(seeds)])
    seed, episode = np.indices(gained.shape).reshape(2, -1)
    value = TASKS[name].gained
    types = {"seed": "int64", "episode": "int64", value: "float64"}
    return DataTable(name, types, {"seed": seed, "episode": episode + 1, value: gained.ravel()})


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition(":")[0])
    parser.add_argument("world", choices=TASKS)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--updates", type=int, default=15)
    parser.add_argument("--plot", default="", help="a picture of the curve, such as curve.png")
    given = parser.parse_args()
    value = TASKS[given.world].gained
    table = curves(given.world, given.seeds, given.updates)
    for number in range(1, given.updates + 1):
        print(number, table[value][table["episode"] == number].round(1).tolist())
    if given.plot:
        table.plot(value, x="episode").save(given.plot)
