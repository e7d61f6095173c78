"""The shipped worlds give their recorded digests, and their messages the recorded bytes."""

import json
import subprocess
import sys

import pytest

from tools.golden import ROOT, WORLDS, recorded_values

pytest.importorskip("yaml", reason="pip install 'minerva-bus[maps]'")

WHY = "tools/golden.py says what to do where a value changes"


@pytest.fixture(scope="module")
def values():
    """Values from a separate process, as some of the worlds' modules have names of tests."""
    words = [sys.executable, "-m", "tools.golden", "--json"]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    assert not done.stderr
    return json.loads(done.stdout)


@pytest.mark.parametrize("world", WORLDS)
def test_a_world_has_its_golden_values(world, values):
    assert values[world] == recorded_values()[world], WHY
