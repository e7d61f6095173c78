"""Events as values: equal, hashable, and rejected if invalid."""

import copy
import pickle

import numpy as np
import pytest

from minerva_bus import Cells, Event, EventType, Primitive, Reals, Scene, Vocabulary, parse
from minerva_bus.errors import VocabularyError

eNear = EventType("eNear", distance=float)
eScan = EventType("eScan", ranges=Reals, hits=Cells, path="list of real", seen=Scene)
VOCABULARY = Vocabulary.of(Primitive("PA"), eNear, eScan)


def scan(last=1.0):
    return eScan(
        ranges=np.array([[0.5, last]]),
        hits=np.eye(2, dtype=np.int16),
        path=[1, 2],
        seen=parse("PA"),
    )


def test_events_are_equal_when_all_fields_are():
    assert eNear(1.0) == eNear(1)
    assert eNear(1.0) != eNear(2.0)
    assert eNear(1.0) != eNear(1.0, sender="a")
    assert eNear(1.0) != "eNear"


def test_events_with_matrices_lists_and_strings_can_be_compared_and_hashed():
    assert scan() == scan()
    assert hash(scan()) == hash(scan())
    assert scan() != scan(last=2.0)
    assert len({scan(), scan(), scan(last=2.0)}) == 2


def test_minus_zero_is_not_zero():
    assert eNear(0.0) != eNear(-0.0)
    assert scan(last=0.0) != scan(last=-0.0)


def test_events_can_be_copied_and_pickled():
    for event in (eNear(1.0, receivers=["a"]), scan()):
        assert copy.copy(event) == copy.deepcopy(event) == event
        assert pickle.loads(pickle.dumps(event)) == event


def test_missing_fields_of_an_event():
    with pytest.raises(AttributeError, match="eNear has no dist; it has distance"):
        _ = eNear(1.0).dist
    with pytest.raises(AttributeError):
        _ = Event.__new__(Event).anything
    assert not hasattr(eNear(1.0), "__array__")


def test_data_by_name():
    assert eNear(1.0).data == {"distance": 1.0}


def test_a_checked_event_is_the_very_event():
    for event in (eNear(1.0, receivers=["a", "b"]), scan()):
        assert VOCABULARY.check_event(event) is event


def test_an_event_from_outside_is_brought_into_its_form():
    raw = Event("eNear", ("distance",), (1,), receivers=("b", "a", "b"))
    checked = VOCABULARY.check_event(raw)
    assert checked == eNear(1.0, receivers=["a", "b"])
    assert type(checked.distance) is float


@pytest.mark.parametrize(
    ("event", "said"),
    [
        (Event("eNaer"), "no event type eNaer; did you mean 'eNear'"),
        (Event("eNear"), r"eNear needs a value for distance \(real\)"),
        (Event("eNear", ("distance",), ("x",)), "distance must be a number"),
        (Event("eNear", ("distance", "x"), (1.0, 1)), "eNear has no x"),
        (Event("eNear", ("distance", "distance"), (1.0, 1.0)), "each name once"),
        (Event("eNear", ("distance",), ()), "one value for each name"),
        (Event("eNear", ("distance",), (float("nan"),)), "a finite number"),
    ],
)
def test_invalid_events_are_rejected_with_their_sender(event, said):
    with pytest.raises(VocabularyError, match=said) as caught:
        VOCABULARY.check_event(event, "member laser")
    assert str(caught.value).startswith("member laser: ")


@pytest.mark.parametrize("name", ["distance", "receivers", "other"])
def test_an_event_cannot_be_changed(name):
    event = eNear(1.0)
    with pytest.raises(AttributeError, match=f"{name} of eNear cannot be .* eNear\\("):
        setattr(event, name, 2.0)
    assert event == eNear(1.0)
