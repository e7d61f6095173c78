"""Steps per CPU second of environments in this process, next to frames without observations.

python -m extensions.learning.benchmarks.environments
"""

import json
import time

import numpy as np

from benchmarks.command import options
from minerva_bus import World
from minerva_learning import parallel_env

STEPS = 200
LIGHTS = World.load("traffic")
eLight = LIGHTS.vocabulary.events["eLight"]
WORLDS = {
    "robot": ("robot", "ARobot", "eSpeed", ["row", "column", "angle"]),
    "meadow": ("meadow", "ARabbit", "eAlarm", ["x", "y", "energy", "fear"]),
    "traffic, 24 cars": (LIGHTS, "ACar", [None, eLight("red", "red")], None),
    "flock, 24 birds": (World.load("flock", birds=24), "ABird", "eTurn", None),
    "flock, 300 birds": (World.load("flock", birds=300), "ABird", "eTurn", None),
}


def rate(step, times):
    """Calls of a function per CPU second."""
    began = time.process_time()
    for _ in range(times):
        step()
    return times / (time.process_time() - began)


def measure(world, kind, act, observe):
    env = parallel_env(world, kind, act, observe, frames=0)
    env.reset(seed=1)
    random = np.random.default_rng(1)
    sizes = []

    def step():
        for agent in env.agents:
            env.action_space(agent).seed(int(random.integers(1 << 31)))
        actions = {agent: env.action_space(agent).sample() for agent in env.agents}
        began = time.process_time()
        env.step(actions)
        sizes.append((len(actions), time.process_time() - began))

    for _ in range(STEPS):
        step()
    agents, seconds = (sum(column) for column in zip(*sizes, strict=True))
    env.close()
    live = World.load(world).start(rate=0.0, seed=1) if isinstance(world, str) else None
    live = live or world.start(rate=0.0, seed=1)
    with live:
        live.step()
        frames = rate(live.step, STEPS)
    return {
        "steps": round(STEPS / seconds),
        "actions": round(agents / seconds),
        "frames": round(frames),
    }


def main():
    """Measure all environments, and print them as JSON."""
    options(__doc__)
    print(json.dumps({name: measure(*world) for name, world in WORLDS.items()}, indent=1))


if __name__ == "__main__":
    main()
