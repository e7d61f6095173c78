"""Hints of error messages: what to write instead."""

import difflib

import numpy as np
import pytest

from minerva_bus import Agent
from minerva_bus.errors import MisuseError, nearest


def test_a_similar_word_is_suggested_and_otherwise_the_known_ones():
    assert nearest("framse", ["frames"], "it has frames") == "; did you mean 'frames'?"
    assert nearest("colour", ["frames"], "it has frames") == "; it has frames"
    assert nearest("colour", ["frames"]) == ""


def test_of_very_many_names_only_those_that_begin_alike_are_compared(monkeypatch):
    names = [f"walker{number:05}" for number in range(20_000)]
    compared, match = [], difflib.get_close_matches

    def close_matches(word, words, **options):
        compared.extend(words)
        return match(word, words, **options)

    monkeypatch.setattr("difflib.get_close_matches", close_matches)
    assert nearest("walker1234x", names).startswith("; did you mean 'walker123")
    assert len(compared) <= 100


@pytest.mark.parametrize("count", [-1, 2.0, "3", None, True])
def test_a_number_of_agents_is_a_whole_number(count):
    class Bird(Agent, symbol="ABird"):
        pass

    with pytest.raises(MisuseError, match=r"ABird.many: count must be a whole number from 0"):
        Bird.many("b", count)
    assert len(Bird.many("b", np.int64(2)).nodes) == 2


def test_a_list_of_values_for_many_agents_is_an_error_that_names_arrays():
    class Patient(Agent, symbol="APatient"):
        state: str = "S"

    with pytest.raises(MisuseError, match="text, not a list; for 2 different values use an array"):
        Patient.many("p", 2, state=["S", "I"])
