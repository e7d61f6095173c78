"""examples/survival: rabbits learn to find grass."""

import sys
from pathlib import Path

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
