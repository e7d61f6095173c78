"""Trains policies for the agents of a world by PPO: python train_ppo.py survival --seeds 4"""

import argparse
from dataclasses import dataclass, field
from typing import Any

import corridor
import crossing
import numpy as np
import survival
from ppo import learn

from minerva_bus import World
from minerva_bus.collect.data_tables import DataTable
from minerva_learning import population_env


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


def street(observations):
    """Speed, way to the line, light, room and speed of the car ahead, shape (n, 5)."""
    s, speed, gap, lead, green = observations.T[:5]
    line = (crossing.LINE - s) % crossing.LENGTH
    near = [np.minimum(1.0, way / 30) for way in (line, np.maximum(gap - crossing.SPACE, 0))]
    return np.stack([speed / 10, near[0], green, near[1], lead / 10], 1)


@dataclass
class Task:
    """A world, its learners, and what they do, observe and gain.

    `gained` is the name of the sum of rewards. `counted` are attributes that are only reported.
    Every `learners`-th agent has the same policy. A curve is drawn for each of `variants`, options.
    """

    world: World
    kind: str
    observed: list[str]
    features: Any
    reward: str | None
    gained: str
    options: dict[str, Any]
    act: str = "eSteer"
    learners: int = 1
    counted: list[str] = field(default_factory=list)
    variants: list[dict[str, Any]] = field(default_factory=lambda: [{}])


BEAMS = [f"beam{number}" for number in range(len(corridor.ANGLES))]
TASKS = {
    "survival": Task(survival.world, "ARabbit", ["left", "right", "energy"], smell, None,
                     "lifetime", {"rabbits": 48}),
    "corridor": Task(corridor.world, "ARobot", [*BEAMS, "heading"], scan, "x",
                     "metres", {"robots": 48}),
    "crossing": Task(crossing.world, "ACar", ["s", "speed", "gap", "lead", "green"], street,
                     "earned", "metres", {}, "ePedal", 2, ["fines", "crashes"],
                     [{"norms": True}, {"norms": False}]),
}  # fmt: skip


def train(name, seed=0, updates=15, frames=300, **variant):
    """The trained policies, and by name what the agents gained and counted in each episode."""
    task = TASKS[name]
    observed = [*task.observed, *task.counted]
    options = {**task.options, **variant}
    envs = population_env(
        task.world, task.kind, task.act, observed, task.reward, frames=frames, **options
    )
    teams = [np.arange(first, envs.num_envs, task.learners) for first in range(task.learners)]
    policies, curve = learn(envs, task.features, seed, updates, teams=teams)
    envs.close()
    # The first column is the sum of rewards, then come the last observations.
    columns = [0, *range(1 + len(task.observed), curve.shape[1])]
    return policies, dict(zip([task.gained, *task.counted], curve.T[columns], strict=True))


def curves(name, seeds, updates):
    """The curves of several trainings, as a table."""
    task, columns, episodes = TASKS[name], {}, np.arange(updates) + 1
    for variant in task.variants:
        for seed in range(seeds):
            options = {key: np.full(updates, value) for key, value in variant.items()}
            curve = train(name, seed, updates, **variant)[1]
            part = {**options, "seed": np.full(updates, seed), "episode": episodes, **curve}
            columns = {
                key: np.concatenate([columns.get(key, []), part[key]]).astype(part[key].dtype)
                for key in part
            }
    kinds = {"b": "bool", "i": "int64", "f": "float64"}
    types = {key: kinds[column.dtype.kind] for key, column in columns.items()}
    return DataTable(name, types, columns)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition(":")[0])
    parser.add_argument("world", choices=TASKS)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--updates", type=int, default=15)
    parser.add_argument("--plot", default="", help="a picture of the curve, such as curve.png")
    given = parser.parse_args()
    task = TASKS[given.world]
    table = curves(given.world, given.seeds, given.updates)
    print(",".join(table.columns))
    for row in table.rows():
        print(*(round(float(value), 2) for value in row), sep=",")
    if given.plot:
        table.plot(task.gained, x="episode").save(given.plot)
