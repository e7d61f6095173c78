"""The shipped worlds do what they did, and their messages travel as they did: tools/golden.py."""

import json
import subprocess
import sys
from typing import get_args

import pytest

from minerva_bus.frame import messages as m
from tools.golden import ROOT, SAMPLES, WORLDS, recorded_values

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


def test_single_messages_have_their_golden_bytes(values):
    assert values["samples"] == recorded_values()["samples"], WHY


def test_every_message_has_a_golden_value():
    recorded = recorded_values()
    names = {name for table in recorded.values() for name in table} - {"string"}
    assert names == {message.__name__ for message in get_args(m.Message)}
    assert len({type(message) for message in SAMPLES}) == len(SAMPLES)
