"""The shipped worlds do what they did, and their messages travel as they did: tools/golden.py."""

from typing import get_args

import pytest

from minerva_bus.frame import messages as m
from tools.golden import SAMPLES, WORLDS, golden_values, recorded_values, sample_values

pytest.importorskip("yaml", reason="pip install 'minerva-bus[maps]'")

WHY = "tools/golden.py says what to do where a value changes"


@pytest.mark.parametrize("world", WORLDS)
def test_a_world_has_its_golden_values(world):
    assert golden_values(world) == recorded_values()[world], WHY


def test_single_messages_have_their_golden_bytes():
    assert sample_values() == recorded_values()["samples"], WHY


def test_every_message_has_a_golden_value():
    recorded = recorded_values()
    names = {name for table in recorded.values() for name in table} - {"string"}
    assert names == {message.__name__ for message in get_args(m.Message)}
    assert len({type(message) for message in SAMPLES}) == len(SAMPLES)
