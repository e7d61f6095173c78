"""Hints of error messages: what to write instead."""

import pytest

from minerva_bus import Agent
from minerva_bus.errors import MisuseError, nearest


def test_a_similar_word_is_suggested_and_otherwise_the_known_ones():
    assert nearest("framse", ["frames"], "it has frames") == "; did you mean 'frames'?"
    assert nearest("colour", ["frames"], "it has frames") == "; it has frames"
    assert nearest("colour", ["frames"]) == ""


def test_a_list_of_values_for_many_agents_is_an_error_that_names_arrays():
    class Patient(Agent, symbol="APatient"):
        state: str = "S"

    with pytest.raises(MisuseError, match="text, not a list; for 2 different values use an array"):
        Patient.many("p", 2, state=["S", "I"])
