"""examples/space: arms that reach and cars that drive, and shipped worlds, as environments."""

import sys
import warnings
from pathlib import Path

import pytest

pytest.importorskip("gymnasium")
pytest.importorskip("pettingzoo")
pytest.importorskip("rapier3d", reason="needs the extra space")
pytest.importorskip("minerva_bodies", reason="needs the extension bodies")

from gymnasium.utils.env_checker import check_env
from pettingzoo.test import parallel_api_test

from minerva_learning import single_env

FOLDER = Path(__file__).parents[3] / "examples" / "space"


@pytest.mark.parametrize(
    ("name", "frames"), [("reach", 50), ("drive", 50), ("arm", 20), ("rover", 60)]
)
def test_a_trained_policy_beats_chance(monkeypatch, name, frames):
    monkeypatch.syspath_prepend(str(FOLDER))
    try:
        import train_space

        task = train_space.TASKS[name]
        env = train_space.environment(task, robots=4, frames=frames)
        policies = train_space.by_chance(env, 1), train_space.linear(task, env, task.trained)
        count = len(env.possible_agents)
        gained = [train_space.episode(env, [policy] * count, seed=2).mean() for policy in policies]
        assert gained[1] > gained[0] + 0.3
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            parallel_api_test(env, num_cycles=3)
            first, given = f"#{env.possible_agents[0]}", task.settings(1)
            check_env(single_env(task.world(), first, task.act, frames=3, **given))
    finally:
        for module in ("train_space", "reach", "drive"):
            sys.modules.pop(module, None)
