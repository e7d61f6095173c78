"""The shipped worlds do what they did, and their messages travel as they did: tools/golden.py."""

import json
import subprocess
import sys

import pytest

from tools.golden import ROOT, WORLDS, recorded_values

pytest.importorskip("yaml", reason="pip install 'minerva-bus[maps]'")

WHY = "tools/golden.py says what to do where a value changes"


@pytest.fixture(scope="module")
def values():
    """From a process of its own: the worlds' modules have the names of some of the tests'."""
    words = [sys.executable, "-m", "tools.golden", "--json"]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    assert not done.stderr
    return json.loads(done.stdout)


@pytest.mark.parametrize("world", WORLDS)
def test_a_world_has_its_golden_values(world, values):
    assert values[world] == recorded_values()[world], WHY
