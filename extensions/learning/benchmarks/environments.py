"""The CPU time of a step of an environment beside that of a frame of the same world without it.

    python -m extensions.learning.benchmarks.environments [--turns 8] [--json]

Steps and frames take turns of ten, all in this process. A step has an action of each agent that
changes nothing else. It is compared with a frame that has the same events of a program, and with
one that has none. Ratios are the medians of the turns.
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
from minerva_bus import Agent, EventType, World, each, on
from minerva_bus.api.live import Live
from minerva_bus.grammar.ids import Ids
from minerva_learning import parallel_env, population_env, single_env, vector_env

sys.path.insert(0, str(Path(__file__).parents[3] / "examples" / "survival"))

CALLS: Final = 10
BLOCKS: Final = 4
WORLDS: Final = 4
COLUMNS: Final = {
    "world": "<10", "agents": ">6", "environment": "<11", "frame µs": ">9.0f",
    "events µs": ">9.0f", "step µs": ">9.0f", "ratio": ">6.2f", "empty": ">6.2f",
}  # fmt: skip

eStep = EventType("eStep")
eMove = EventType("eMove", way=float)


class Dot(Agent, symbol="ADot"):
    """An agent that does almost nothing."""

    x: float = 0.0

    @on("eMove")
    def move(self, move: Any, moment: Any) -> None:
        self.x += move.way

    @on("eStep")
    def step(self, step: Any, moment: Any) -> None:
        self.x += 0.5


def dots(options: Any) -> str:
    """The string of a tiny world."""
    return " · ".join(f"ADot#d{number}" for number in range(options["dots"]))


def cases() -> dict[tuple[str, int], tuple[Any, ...]]:
    """World, its options, kind, action and observation."""
    from survival import world

    eLight = World.load("traffic").vocabulary.events["eLight"]
    rabbits = ("ARabbit", "eSteer", ["left", "right", "energy"])
    lights = ("ACar", [None, eLight("red", "red")], None)
    robot = ("ARobot", "eSpeed", ["row", "column", "angle"])
    tiny = World(
        dots, agents=[Dot], services=[each(eStep)], symbols=[eMove], order=[eMove, eStep],
        options={"dots": 1}, name="dots",
    )  # fmt: skip
    return {
        **{("dots", n): (tiny, {"dots": n}, "ADot", "eMove", ["x"]) for n in (1, 3, 30)},
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


def eventful(live: Live, env: Any) -> Callable[[], Any]:
    """A frame of a world with the events of a step of this environment that has begun."""
    space = env.action_space(env.agents[0])
    action = np.zeros(space.shape, space.dtype) if space.shape else 1
    acting = env._episode.task.acting
    events = acting.events(Ids.of(env.agents), [action] * len(env.agents))

    def frame() -> None:
        for event in events:
            live.publish(event)
        live.step()

    return frame


def spent(call: Callable[[], Any]) -> float:
    """CPU time in µs."""
    began = time.process_time()
    for _ in range(CALLS):
        call()
    return 1e6 * (time.process_time() - began) / CALLS


def measure(name: str, agents: int, turns: int, table: Table) -> None:
    world, given, *task = cases()[name, agents]
    times: dict[str, list[tuple[float, float, float]]] = {}
    for _ in range(turns):
        envs = made(world, given, tuple(task), agents)
        # The rabbits starve soon.
        own, start = World.load(world) if isinstance(world, str) else world, {"seed": 1, **given}
        with own.start(rate=0.0, **start) as live, own.start(rate=0.0, **start) as other:
            steps = {env: stepping(made) for env, (made, _) in envs.items()}
            acted = eventful(other, envs["parallel"][0])
            for call in (live.step, acted, *steps.values()):
                call()
            for _ in range(BLOCKS):
                frame, events = spent(live.step), spent(acted)
                for env, call in steps.items():
                    times.setdefault(env, []).append((frame, events, spent(call) / envs[env][1]))
        for env, _ in envs.values():
            env.close()
    for env, taken in times.items():
        frame, events, step = map(statistics.median, zip(*taken, strict=True))
        table.row({
            "world": name, "agents": agents, "environment": env, "frame_us": frame,
            "events_us": events, "step_us": step,
            "ratio": statistics.median(step / events for _, events, step in taken),
            "empty": statistics.median(step / frame for frame, _, step in taken),
        })  # fmt: skip


def main() -> None:
    """Print a row for each world and environment."""
    given = options(__doc__, turns=8)
    table = Table(COLUMNS, as_json=given.json)
    for name, agents in cases():
        measure(name, agents, given.turns, table)


if __name__ == "__main__":
    main()
