"""Trains one policy for all rabbits by PPO: python train_ppo.py --seeds 4 --plot curve.png"""

import argparse

import numpy as np
from ppo import learn
from survival import world

from minerva_bus.collect.table import DataTable
from minerva_bus.rl import population_env

OBSERVED = ["left", "right", "energy"]


def features(observations):
    """The difference and the strength of the smells, and the energy, shape (n, 3)."""
    left, right, energy = observations.T
    smell = left + right
    return np.stack([10 * (left - right) / (smell + 1e-9), np.log(smell + 0.1), energy - 2], 1)


def train(seed=0, updates=15, frames=300, rabbits=48):
    """The trained policy, and the mean lifetime in each episode."""
    envs = population_env(world, "ARabbit", "eSteer", OBSERVED, frames=frames, rabbits=rabbits)
    policy, curve = learn(envs, features, seed, updates)
    envs.close()
    return policy, curve


def curves(seeds, updates):
    """The lifetimes of several trainings, as a table."""
    lifetimes = np.array([train(seed, updates)[1] for seed in range(seeds)])
    seed, episode = np.indices(lifetimes.shape)
    types = {"seed": "int64", "episode": "int64", "lifetime": "float64"}
    columns = {
        "seed": seed.ravel(),
        "episode": episode.ravel() + 1,
        "lifetime": lifetimes.ravel(),
    }
    return DataTable("survival", types, columns)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition(":")[0])
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--updates", type=int, default=15)
    parser.add_argument("--plot", default="", help="a picture of the curve, such as curve.png")
    given = parser.parse_args()
    table = curves(given.seeds, given.updates)
    for number in range(1, given.updates + 1):
        print(number, table["lifetime"][table["episode"] == number].round(1).tolist())
    if given.plot:
        table.plot("lifetime", x="episode").save(given.plot)
