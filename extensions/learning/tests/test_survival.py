"""examples/survival: rabbits learn to find grass."""

import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("gymnasium")
pytest.importorskip("pettingzoo")

from minerva_learning import population_env

FOLDER = Path(__file__).parents[3] / "examples" / "survival"


def test_rabbits_live_longer_after_training(monkeypatch):
    monkeypatch.syspath_prepend(str(FOLDER))
    try:
        import train

        weights, curve = train.train(seed=1, generations=3, frames=120, rabbits=12)
        # A positive weight of the difference turns towards the stronger scent.
        assert weights[0] > 0
        assert curve[-1] > curve[0]
    finally:
        for name in ("train", "survival"):
            sys.modules.pop(name, None)


SMELL = [[0.4, 0.3, 2.0]]
WALL_ON_THE_RIGHT = [[1.0, 1.0, 1.0, 4.0, 6.0, 6.0, 6.0, 0.0]]


@pytest.mark.parametrize(
    ("world", "seed", "updates", "observed"),
    [("survival", 2, 6, SMELL), ("corridor", 0, 4, WALL_ON_THE_RIGHT)],
)
def test_one_policy_of_all_agents_learns_by_ppo(monkeypatch, world, seed, updates, observed):
    monkeypatch.syspath_prepend(str(FOLDER))
    try:
        import train_ppo

        policies, curve = train_ppo.train(world, seed, updates, frames=150)
        gained = curve[train_ppo.TASKS[world].gained]
        assert gained[-1] > gained[0]
        # Towards the stronger smell, or away from the wall: to the left.
        assert policies[0](train_ppo.TASKS[world].features(np.array(observed))) > 0
    finally:
        for name in ("train_ppo", "ppo", "survival", "corridor", "crossing"):
            sys.modules.pop(name, None)


def test_norms_bind_learners(monkeypatch):
    """All drivers push the pedal down: norms keep them apart, and fine them for their speed."""
    monkeypatch.syspath_prepend(str(FOLDER))
    try:
        import crossing

        counted = {}
        for norms in (True, False):
            envs = population_env(
                crossing.world, "ACar", "ePedal", ["crashes", "fines"], "earned", norms=norms
            )
            observations, _ = envs.reset(seed=1)
            earned = np.zeros(envs.num_envs)
            for _ in range(60):
                observations, rewards, *_ = envs.step(np.full((envs.num_envs, 1), 4.0))
                earned += rewards
            envs.close()
            crashes, fines = observations.sum(0)
            counted[norms] = crashes > 0, fines > 0, earned.sum() > 0
        assert counted == {True: (False, True, True), False: (True, False, False)}
    finally:
        sys.modules.pop("crossing", None)


def test_each_learner_has_a_policy_of_its_own(monkeypatch):
    monkeypatch.syspath_prepend(str(FOLDER))
    try:
        import train_ppo

        policies, curve = train_ppo.train("crossing", updates=2, frames=20)
        assert len(policies) == 2
        assert set(curve) == {"metres", "fines", "crashes"}
        near = train_ppo.TASKS["crossing"].features(np.array([[0.0, 5.0, 20.0, 5.0, 1.0]]))
        assert policies[0](near) != policies[1](near)
    finally:
        for name in ("train_ppo", "ppo", "survival", "corridor", "crossing"):
            sys.modules.pop(name, None)
