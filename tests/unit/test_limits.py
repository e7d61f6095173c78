"""Value ranges, and texts taken from the string, in the data of event types."""

from typing import Annotated

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from minerva_bus import (
    EventType,
    MetresPerSecond,
    Of,
    Primitive,
    Range,
    Transformation,
    Vocabulary,
    parse,
)
from minerva_bus.errors import MisuseError
from minerva_bus.grammar.arrays import fits
from minerva_bus.grammar.column import Column
from minerva_bus.grammar.fitting import Unfit
from minerva_bus.grammar.known import values_of
from minerva_bus.grammar.types import Type, parse_type, type_of
from minerva_bus.wire.vocabulary import plain_vocabulary, read_vocabulary

eSpeed = EventType("eSpeed", speed=Annotated[MetresPerSecond, Range(least=0.0)])
eThrow = EventType("eThrow", dice=Annotated[int, Range(1, 6)])
PMark = Primitive("PMark", name=str)
TAt = Transformation("TAt", x=float)


def test_a_number_outside_its_range_is_refused_with_what_is_expected():
    assert eSpeed(0.0).speed == 0.0
    with pytest.raises(MisuseError, match=r"eSpeed: speed must be a number in m/s from 0 up, not"):
        eSpeed(-1.0)
    with pytest.raises(MisuseError, match=r"from 0 up"):
        eSpeed(-1)
    with pytest.raises(MisuseError, match=r"dice must be a number from 1 to 6, not 7"):
        eThrow(7)


def test_arrays_are_held_to_a_range_too():
    assert len(eSpeed(np.array([0.0, 2.0]))) == 2
    with pytest.raises(MisuseError, match=r"from 0 up, not -0\.5"):
        eSpeed(np.array([1.0, -0.5]))
    kind = eSpeed.fields.all[0].type
    assert fits(kind, Column(np.array([0.0, 2.0])))
    assert not fits(kind, Column(np.array([2.0, -0.5])))
    assert not fits(kind, Column(np.array([2.0, np.nan, 1.0])))
    assert fits(kind, Column(np.empty(0)))


@given(st.floats(-1e9, 1e9), st.floats(-1e9, 1e9), st.floats(-2e9, 2e9))
def test_a_type_with_a_range_reads_back_and_holds_what_lies_in_it(first, other, number):
    kind = Type("real", "m", range=Range(min(first, other), max(first, other)))
    assert parse_type(str(kind)) == kind
    if min(first, other) <= number <= max(first, other):
        assert kind.fit(number) == number
    else:
        with pytest.raises(Unfit):
            kind.fit(number)


@pytest.mark.parametrize("text", ["real m/s 0..", "int ..6", "real 0.5..1", "text of PMark.name"])
def test_texts_of_types_read_back(text):
    assert str(parse_type(text)) == text


@pytest.mark.parametrize("text", ["real m 2..1", "real ..", "text 0..", "int a..", "text of name"])
def test_texts_that_name_no_range_are_refused(text):
    with pytest.raises(MisuseError):
        parse_type(text)


def test_they_travel_with_the_vocabulary():
    eGo = EventType("eGo", to=Annotated[str, Of("PMark", "name")])
    vocabulary = Vocabulary.of(eSpeed, eThrow, eGo, PMark)
    again = read_vocabulary(plain_vocabulary(vocabulary))
    for name, declared in vocabulary.events.items():
        assert again.events[name].fields == declared.fields


def test_a_vocabulary_rejects_them_where_they_do_not_fit():
    with pytest.raises(MisuseError, match=r"PDot: x is a real 0\.\.; only data of event types"):
        Vocabulary.of(Primitive("PDot", x=Annotated[float, Range(least=0.0)]))
    eGo = EventType("eGo", to=Annotated[str, Of("PMark", "nam")])
    with pytest.raises(MisuseError, match=r"eGo: to is a text of PMark\.nam.*did you mean 'PMark"):
        Vocabulary.of(eGo, PMark)
    with pytest.raises(MisuseError, match="is for real or int, not for text"):
        type_of(Annotated[str, Range(0, 1)])


def test_values_of_a_parameter_are_found_wherever_they_stand():
    names = np.array([f"m{number}" for number in range(40)], dtype=object)
    scene = parse('TAt<x=1>(PMark<name="a"> · TAt<x=2>(PMark<name="b">))')
    scene += TAt(np.arange(40.0))(PMark(names))
    assert list(values_of(scene, Of("PMark", "name"))) == ["a", "b", *names]
    assert list(values_of(scene, Of("TAt", "x")))[:3] == [1, 2, 0.0]
