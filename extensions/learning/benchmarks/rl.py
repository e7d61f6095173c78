"""Steps per second of environments for learning, next to Mesa and MPE.

    python -m extensions.learning.benchmarks.rl [--steps 1500] [--turns 3] [--json]

A step is that of one agent. The rabbits of examples/survival are the same model in Minerva Bus and,
wrapped by hand, in Mesa: one world, 16 worlds in two processes (AsyncVectorEnv of Gymnasium starts
16 for Mesa), and 1,000 rabbits in one world. `simple_spread` of MPE (`pip install mpe2`), with one
and with three agents, is another and simpler model. In each turn all systems run one after the
other. CPU seconds are those of all processes, with resets. The ratio is that of steps per CPU
second to one world in Mesa.
"""

from __future__ import annotations

import resource
import statistics
import sys
import time
from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import numpy as np
from gymnasium.vector import AsyncVectorEnv

from benchmarks.command import Table, options
from extensions.learning.benchmarks.rabbits import MesaEnv
from minerva_learning import population_env, single_env, vector_env

sys.path.insert(0, str(Path(__file__).parents[3] / "examples" / "survival"))

FRAMES: Final = 60  # All rabbits that walk straight on survive as long.
RABBITS: Final = 1000
WORLDS: Final = 16
REFERENCE: Final = "Mesa, one world"
COLUMNS: Final = {"system": "<36", "steps/CPU s": ">12.0f", "steps/wall s": ">13.0f",
                  "ratio": ">8.2f"}  # fmt: skip


def ours(make: Callable[..., Any], **settings: Any) -> Any:
    from survival import world

    return make(world, "ARabbit", "eSteer", ["left", "right", "energy"], frames=FRAMES, **settings)


def single(env: Any, steps: int) -> int:
    """Step an environment; returns the number of agents' steps."""
    env.reset(seed=1)
    action = np.zeros(env.action_space.shape)
    for _ in range(steps):
        _, _, terminated, truncated, _ = env.step(action)
        if np.all(terminated | truncated):
            env.reset()
    env.close()
    return steps * (len(action) if action.ndim > 1 else 1)


def parallel(env: Any, steps: int) -> int:
    """Step an environment of MPE; returns the number of agents' steps."""
    env.reset(seed=1)
    done = 0
    for _ in range(steps):
        if not env.agents:
            env.reset()
        done += len(env.agents)
        env.step({agent: np.zeros(5, np.float32) for agent in env.agents})
    env.close()
    return done


def mpe(agents: int) -> Any:
    from mpe2 import simple_spread_v3

    return simple_spread_v3.parallel_env(N=agents, max_cycles=FRAMES, continuous_actions=True)


def systems(steps: int) -> dict[str, Callable[[], int]]:
    several, many = steps // 4, steps // 10
    mesa = partial(MesaEnv, frames=FRAMES)
    return {
        "Minerva Bus, one world": lambda: single(ours(single_env, rabbits=1), steps),
        "Minerva Bus, 16 worlds": lambda: single(
            ours(vector_env, rabbits=1, worlds=WORLDS, processes=2), several
        ),
        "Minerva Bus, 1,000 in one world": lambda: single(
            ours(population_env, rabbits=RABBITS), many
        ),
        REFERENCE: lambda: single(mesa(1), steps),
        "Mesa, 16 worlds": lambda: single(
            AsyncVectorEnv([partial(mesa, 1)] * WORLDS, context="fork"), several
        ),
        "Mesa, 1,000 in one world": lambda: single(mesa(RABBITS), many),
        **({} if find_spec("mpe2") is None else of_mpe(steps)),
    }


def of_mpe(steps: int) -> dict[str, Callable[[], int]]:
    return {
        "MPE, one agent": lambda: parallel(mpe(1), steps),
        "MPE, three agents": lambda: parallel(mpe(3), steps),
    }


def cpu() -> float:
    """CPU seconds of this process and of those that it has waited for."""
    used = map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(each.ru_utime + each.ru_stime for each in used)


def measured(run: Callable[[], int]) -> tuple[float, float]:
    """Agents' steps per CPU second and per second of wall time."""
    before, began = cpu(), time.perf_counter()
    steps = run()
    return steps / (cpu() - before), steps / (time.perf_counter() - began)


def main() -> None:
    given = options(__doc__, steps=1500, turns=3)
    runs = systems(given.steps)
    for name, run in systems(20).items():  # Imports.
        if "16" not in name:
            run()
    rates: dict[str, list[tuple[float, float]]] = {system: [] for system in runs}
    for _ in range(given.turns):
        for system, run in runs.items():
            rates[system].append(measured(run))
    medians = {
        system: [statistics.median(values) for values in zip(*turns, strict=True)]
        for system, turns in rates.items()
    }
    table = Table(COLUMNS, as_json=given.json)
    for system, (per_cpu, per_wall) in medians.items():
        table.row({"system": system, "steps_per_cpu_s": per_cpu, "steps_per_wall_s": per_wall,
                   "ratio": per_cpu / medians[REFERENCE][0]})  # fmt: skip


if __name__ == "__main__":
    main()
