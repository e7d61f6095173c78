"""examples/survival: rabbits learn to find grass."""

import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("gymnasium")
pytest.importorskip("pettingzoo")

FOLDER = Path(__file__).parents[2] / "examples" / "survival"


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


def test_one_policy_of_all_rabbits_learns_by_ppo(monkeypatch):
    monkeypatch.syspath_prepend(str(FOLDER))
    try:
        import train_ppo

        policy, curve = train_ppo.train(seed=2, updates=6, frames=150, rabbits=48)
        assert curve[-1] > curve[0]
        # A rabbit that smells more on its left turns to the left.
        assert policy(train_ppo.features(np.array([[0.4, 0.3, 2.0]]))) > 0
    finally:
        for name in ("train_ppo", "ppo", "survival"):
            sys.modules.pop(name, None)
