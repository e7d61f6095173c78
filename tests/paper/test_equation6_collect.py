"""Equation 6: E(C*, t) collects the events of all generators, each once, in a single order."""

from itertools import permutations

import pytest

from minerva_bus import EventType
from minerva_bus.world.event_collection import Priority, collect

eLaser = EventType("eLaser", dist=float, angle=float)
eCamera = EventType("eCamera", marker=str)
eDecide = EventType("eDecide")
eZoom = EventType("eZoom", n=int)
eAlarm = EventType("eAlarm", n=int)

ORDER = Priority(("eLaser", "eCamera", "eDecide"))


def test_no_generators_no_events():
    assert collect(ORDER, {}) == ()


def test_no_event_is_collected_twice():
    """e(z, e^i) = z if e^i ∈ z."""
    assert collect(ORDER, {"a": [eDecide(), eDecide()]}) == (eDecide(),)


def test_two_sensors_that_see_the_same_report_it_once():
    """Section 4.3: a new device provides redundant information without other modifications."""
    seen, also = eLaser(1.0, 90.0), eLaser(2.0, 0.0)
    assert collect(ORDER, {"front": [seen], "rear": [seen, also]}) == (seen, also)


@pytest.mark.parametrize(
    "other",
    [
        eLaser(1.0, 90.0, receivers=["r1"]),
        eLaser(1.0, 90.0, sender="r1"),
        eLaser(1.0, 90.0, condition="x > 1"),
        eLaser(1.0, 91.0),
        eLaser(1.0, -90.0),
    ],
    ids=str,
)
def test_events_that_differ_in_anything_are_two(other):
    assert len(collect(ORDER, {"a": [eLaser(1.0, 90.0)], "b": [other]})) == 2


def test_plus_and_minus_zero_are_two():
    """They print differently, so a record distinguishes them."""
    assert len(collect(ORDER, {"a": [eLaser(0.0, 0.0), eLaser(-0.0, 0.0)]})) == 2


def test_the_order_is_priority_then_generator_then_sequence():
    """Section 4.2.2: events of data acquisition precede those of decision making."""
    sources = {
        "mind": [eDecide()],
        "rear": [eLaser(3.0, 0.0), eCamera("m1")],
        "front": [eLaser(2.0, 0.0), eLaser(1.0, 0.0)],
    }
    assert collect(ORDER, sources) == (
        eLaser(2.0, 0.0),
        eLaser(1.0, 0.0),
        eLaser(3.0, 0.0),
        eCamera("m1"),
        eDecide(),
    )


def test_types_without_a_priority_are_last_by_name():
    sources = {"x": [eZoom(1), eAlarm(2), eDecide()]}
    assert collect(ORDER, sources) == (eDecide(), eAlarm(2), eZoom(1))


def test_the_order_of_arrival_is_of_no_consequence():
    sources = {
        "a": [eZoom(1), eDecide()],
        "b": [eLaser(1.0, 2.0), eZoom(1)],
        "c": [eCamera("x"), eAlarm(1), eZoom(3)],
    }
    arrived = [collect(ORDER, dict(order)) for order in permutations(sources.items())]
    assert len(set(arrived)) == 1


def test_the_order_within_one_generator_is_that_in_which_it_spoke():
    events = [eZoom(n) for n in (3, 1, 2)]
    assert collect(ORDER, {"a": events}) == tuple(events)


def test_the_order_is_total():
    keys = {
        ORDER.key(event_type, source, n)
        for event_type in ("eLaser", "eDecide", "eZoom", "eAlarm")
        for source in ("a", "b")
        for n in (0, 1)
    }
    assert len(keys) == 16
    assert ORDER.key("eLaser", "z", 9) < ORDER.key("eDecide", "a", 0) < ORDER.key("eAlarm", "a", 0)
