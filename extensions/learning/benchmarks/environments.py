"""The CPU time of a step of an environment beside that of a frame of the same world without it.

    python -m extensions.learning.benchmarks.environments [--turns 8] [--json]

Steps and frames take turns of ten, all in this process. A step has an action of each agent that
changes nothing else, and the frame has no event of a person. The ratio is the median of the turns.
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.command import Table, options
from minerva_bus import World
from minerva_learning import parallel_env, population_env, single_env, vector_env

sys.path.insert(0, str(Path(__file__).parents[3] / "examples" / "survival"))

CALLS: Final = 10
BLOCKS: Final = 4
WORLDS: Final = 4
COLUMNS: Final = {"world": "<10", "agents": ">6", "environment": "<11", "frame µs": ">9.0f",
                  "step µs": ">9.0f", "ratio": ">6.2f"}  # fmt: skip


def cases() -> dict[tuple[str, int], tuple[Any, ...]]:
    """World, its options, kind, action and observation."""
    from survival import world

    eLight = World.load("traffic").vocabulary.events["eLight"]
    rabbits = ("ARabbit", "eSteer", ["left", "right", "energy"])
    lights = ("ACar", [None, eLight("red", "red")], None)
    robot = ("ARobot", "eSpeed", ["row", "column", "angle"])
    return {
        **{("survival", n): (world, {"rabbits": n}, *rabbits) for n in (1, 24, 300)},
        **{("flock", n): ("flock", {"birds": n}, "ABird", "eTurn", None) for n in (24, 300)},
        ("traffic", 24): ("traffic", {}, *lights),
        ("robot", 1): ("robot", {}, *robot),
    }


def made(world: Any, given: dict[str, Any], task: tuple[Any, ...], agents: int) -> dict[str, Any]:
    """The environments of a world, with the number of worlds in each."""
    settings = {**given, "frames": 0}
    envs = {"parallel": (parallel_env(world, *task, births=False, **settings), 1)}
    if agents > 1:
        return envs | {"population": (population_env(world, *task, **settings), 1)}
    vector = vector_env(world, *task, worlds=WORLDS, **settings)
    return envs | {"single": (single_env(world, *task, **settings), 1), "vector": (vector, WORLDS)}


def stepping(env: Any) -> Callable[[], Any]:
    """A step of an environment that has begun."""
    env.reset(seed=1)
    if hasattr(env, "possible_agents"):
        space = env.action_space(env.agents[0])
        action = np.zeros(space.shape, space.dtype) if space.shape else 1
        return lambda: env.step(dict.fromkeys(env.agents, action))
    space = env.action_space
    return lambda: env.step(np.zeros(space.shape, space.dtype))


def spent(call: Callable[[], Any]) -> float:
    """CPU time in µs."""
    began = time.process_time()
    for _ in range(CALLS):
        call()
    return 1e6 * (time.process_time() - began) / CALLS


def measure(name: str, agents: int, turns: int, table: Table) -> None:
    world, given, *task = cases()[name, agents]
    times: dict[str, list[tuple[float, float]]] = {}
    for _ in range(turns):
        envs = made(world, given, tuple(task), agents)
        # The rabbits starve soon.
        with (World.load(world) if isinstance(world, str) else world).start(
            rate=0.0, seed=1, **given
        ) as live:
            steps = {env: stepping(made) for env, (made, _) in envs.items()}
            for call in (live.step, *steps.values()):
                call()
            for _ in range(BLOCKS):
                frame = spent(live.step)
                for env, call in steps.items():
                    times.setdefault(env, []).append((frame, spent(call) / envs[env][1]))
        for env, _ in envs.values():
            env.close()
    for env, pairs in times.items():
        frame, step = map(statistics.median, zip(*pairs, strict=True))
        ratio = statistics.median(step / frame for frame, step in pairs)
        table.row({"world": name, "agents": agents, "environment": env, "frame_us": frame,
                   "step_us": step, "ratio": ratio})  # fmt: skip


def main() -> None:
    """Print a row for each world and environment."""
    given = options(__doc__, turns=8)
    table = Table(COLUMNS, as_json=given.json)
    for name, agents in cases():
        measure(name, agents, given.turns, table)


if __name__ == "__main__":
    main()
