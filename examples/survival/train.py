"""Trains rabbits to survive, by the cross-entropy method: python train.py --seeds 5

Each rabbit follows a policy of its own, a candidate. The best quarter of a generation determines
the normal distribution of the next one. A policy is linear in three numbers; no library for
learning is needed.
"""

import argparse

import numpy as np
from survival import world

from minerva_bus.collect.data_tables import DataTable
from minerva_learning import parallel_env

OBSERVED = ["left", "right", "energy"]
FRAMES, RABBITS = 300, 24


def action(weights, observation):
    """The turn of a policy in degrees, for what a rabbit smells and how hungry it is."""
    left, right, energy = observation
    difference = (left - right) / (left + right + 1e-9)
    return [30 * np.tanh(weights @ [10 * difference, energy - 2, 1.0])]


def lifetimes(env, weights, seed):
    """The number of frames that each rabbit survives with its weights, shape (n, 3)."""
    observations, _ = env.reset(seed=seed)
    policies = dict(zip(env.agents, weights, strict=True))
    lived = dict.fromkeys(policies, 0.0)
    while env.agents:
        actions = {name: action(policies[name], observations[name]) for name in env.agents}
        observations, rewards, *_ = env.step(actions)
        for name, reward in rewards.items():
            lived[name] += reward
    return np.array([*lived.values()])


def train(seed=0, generations=12, frames=FRAMES, rabbits=RABBITS):
    """The mean weights after the last generation, and the mean lifetime in each generation."""
    random = np.random.default_rng(seed)
    mean, spread = np.zeros(3), np.full(3, 2.0)
    curve = []
    env = parallel_env(world, "ARabbit", "eSteer", OBSERVED, frames=frames, rabbits=rabbits)
    for _ in range(generations):
        weights = mean + spread * random.normal(size=(rabbits, 3))
        # Candidates begin at other places in each generation, so luck does not accumulate.
        lived = lifetimes(env, weights, seed=int(random.integers(1 << 31)))
        best = weights[np.argsort(-lived, kind="stable")[: rabbits // 4]]
        mean, spread = best.mean(axis=0), best.std(axis=0) + 0.1
        curve.append(float(lived.mean()))
    env.close()
    return mean, curve


def curves(seeds, generations):
    """The lifetimes of several trainings, as a table."""
    rows = [
        (seed, generation, lifetime)
        for seed in range(seeds)
        for generation, lifetime in enumerate(train(seed, generations)[1], 1)
    ]
    seed, generation, lifetime = map(np.array, zip(*rows, strict=True))
    types = {"seed": "int64", "generation": "int64", "lifetime": "float64"}
    columns = {"seed": seed, "generation": generation, "lifetime": lifetime}
    return DataTable("survival", types, columns)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--generations", type=int, default=12)
    parser.add_argument("--plot", default="", help="a picture of the curve, such as curve.png")
    given = parser.parse_args()
    table = curves(given.seeds, given.generations)
    for number in range(1, given.generations + 1):
        print(number, table["lifetime"][table["generation"] == number].round(1).tolist())
    if given.plot:
        table.plot("lifetime", x="generation").save(given.plot)
