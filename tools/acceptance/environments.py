"""PettingZoo and Gymnasium: their own tests of environments, for kinds of all installed worlds.

python -m tools.acceptance.environments     # with the clones on PYTHONPATH; prints results
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import warnings
from collections.abc import Callable, Iterator
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from minerva_bus import MinervaError, World
from minerva_bus.grammar.scene import agents
from minerva_bus.launch.installed import installed_worlds
from tools.acceptance.suite import MissingSuiteError, Outcome, Result, Suite, judged

FRAMES = 4
MOST_AGENTS = 400
"""Larger populations would only repeat what their first agents do, and take long."""
OUTSIDE = {"ros2", "village"}
"""Worlds that wait for a program outside: a robot, a language model."""
SECONDS = 900.0


def _kinds() -> Iterator[tuple[str, str, str, str]]:
    """Worlds, kinds, their first agents, and the first event type that can be their action."""
    from minerva_learning import parallel_env

    for name in sorted({*installed_worlds()} - OUTSIDE):
        try:
            declared = World.load(name).read().world
        except MinervaError:
            continue  # It needs a library or program that is not here.
        ids: dict[str, list[str]] = {}
        for node in agents(declared.scene):
            ids.setdefault(node.symbol, []).append(node.id)
        for kind, members in sorted(ids.items()):
            if len(members) > MOST_AGENTS:
                continue
            for event in sorted(declared.vocabulary.events):
                env = None
                try:
                    env = parallel_env(name, kind, event, frames=FRAMES)
                    env.reset()
                    env.step({agent: _sent(env.action_space(agent)) for agent in env.agents})
                except MinervaError:
                    continue  # Such agents do not handle it, or people may not send it.
                finally:
                    if env is not None:
                        env.close()
                yield name, kind, members[0], event
                break


def _sent(space: Any) -> Any:
    """An action that sends an event: the last of numbered ones, of which 0 may send none."""
    return space.n - 1 if hasattr(space, "n") else space.sample()


def _tests(name: str, kind: str, first: str, event: str) -> dict[str, Callable[[], Any]]:
    """The tests of an environment, by name."""
    from gymnasium.utils.env_checker import check_env
    from pettingzoo.test import api_test, parallel_api_test, parallel_seed_test, seed_test
    from pettingzoo.utils import parallel_to_aec

    from minerva_learning import parallel_env, single_env

    make = partial(parallel_env, name, kind, event, frames=FRAMES)

    def turns() -> Any:
        return parallel_to_aec(make(births=False))

    def alone() -> Any:
        return single_env(name, f"#{first}", event, frames=FRAMES)

    return {
        "parallel_api_test": lambda: parallel_api_test(make(), num_cycles=2 * FRAMES),
        "parallel_seed_test": lambda: parallel_seed_test(make, num_cycles=FRAMES),
        "api_test": lambda: api_test(turns(), num_cycles=20),
        "seed_test": lambda: seed_test(turns, num_cycles=FRAMES),
        "check_env": lambda: check_env(alone(), skip_render_check=True),
    }


def main() -> None:
    """Print a line of JSON for each test: its case, and the problem or null."""
    warnings.simplefilter("ignore")  # Of spaces without limits.
    results, sys.stdout = sys.stdout, sys.stderr  # The tests print.
    for name, kind, first, event in _kinds():
        for test, run in _tests(name, kind, first, event).items():
            try:
                run()
                problem = None
            except Exception as error:
                problem = f"{type(error).__name__}: {error}"
            case = f"{name}, {kind} by {event}: {test}"
            print(json.dumps([case, problem]), file=results, flush=True)


def _results(folder: Path) -> Iterator[Result]:
    if not (find_spec("gymnasium") and find_spec("pettingzoo")):
        raise MissingSuiteError("it needs PettingZoo: pip install 'minerva-bus[rl]'")
    clones = [folder, folder.parent / "Gymnasium"]
    if not clones[1].exists():
        raise MissingSuiteError(
            f"no {clones[1]}; clone https://github.com/Farama-Foundation/Gymnasium"
        )
    path = os.pathsep.join(map(str, clones))
    done = subprocess.run(
        [sys.executable, "-m", __name__],
        cwd=Path(__file__).resolve().parents[2],
        env=os.environ | {"PYTHONPATH": path},
        capture_output=True, text=True, timeout=SECONDS, check=False,
    )  # fmt: skip
    for line in done.stdout.splitlines():
        case, problem = json.loads(line)
        yield judged(case, [problem] if problem else [])
    if done.returncode:
        yield Result("the process", Outcome.FAILED, done.stderr[-300:])


FARAMA = Suite(
    "farama",
    "Farama-Foundation/PettingZoo",
    ".",
    "environments of all installed worlds, by the tests of PettingZoo and of Gymnasium beside it",
    _results,
)

if __name__ == "__main__":
    main()
