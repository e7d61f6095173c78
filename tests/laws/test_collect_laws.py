"""Equation 6 for columns of events: the collection equals that of the single events."""

from __future__ import annotations

from itertools import groupby

from hypothesis import given, settings
from hypothesis import strategies as st

from minerva_bus import EventType
from minerva_bus.grammar.batch import Events, single
from minerva_bus.world.order import Order, collect

eFirst = EventType("eFirst", n=int)
eLast = EventType("eLast", name=str)
eAlone = EventType("eAlone")
ORDER = Order(("eLast", "eFirst"))

NAMES = st.sampled_from(["a", "b", "c:1"])
SENDERS = st.sampled_from(["", "a", "b"])
RECEIVERS = st.sampled_from([(), ("a",), ("b",), ("a", "b")])
CONDITIONS = st.sampled_from(["", "", "x > 1"])
NUMBERS = st.integers(0, 3)


def events():
    """Events of which many are equal and many differ in a single field."""
    rest = {"sender": SENDERS, "receivers": RECEIVERS, "condition": CONDITIONS}
    return (
        st.builds(eFirst, NUMBERS, **rest)
        | st.builds(eLast, NAMES, **rest)
        | st.builds(eFirst, NUMBERS)
        | st.builds(eAlone, **rest)
    )


SOURCES = st.dictionaries(st.sampled_from(["x", "y", "z"]), st.lists(events(), max_size=8))


def in_columns(given_events, cuts):
    """The same events, with runs of one type in columns where possible."""
    made = []
    for _, run in groupby(enumerate(given_events), lambda pair: (pair[1].type, cuts(pair[0]))):
        together = [event for _, event in run]
        columns = Events.of(together)
        made += together if columns is None else [columns]
    return made


@given(SOURCES, st.sets(st.integers(0, 7)))
@settings(max_examples=100)
def test_columns_change_nothing(sources, separate):
    """Runs are split at random, so that columns are next to columns and to single events."""
    plain = collect(ORDER, sources)
    held = {
        name: in_columns(given_events, lambda at: at if at in separate else -1)
        for name, given_events in sources.items()
    }
    collected = collect(ORDER, held)
    assert list(single(collected)) == list(plain)
    assert len(set(plain)) == len(plain)


@given(SOURCES, st.data())
@settings(max_examples=100)
def test_columns_beside_single_events_change_nothing(sources, data):
    held = {}
    for name, given_events in sources.items():
        run = [event for event in given_events if event.type == "eFirst"]
        columns = Events.of(run) if run and data.draw(st.booleans()) else None
        others = [event for event in given_events if event.type != "eFirst"]
        held[name] = others + (run if columns is None else [columns])
    assert list(single(collect(ORDER, held))) == list(collect(ORDER, sources))


def test_packable_agents_return_to_columns():
    """Columns and single events of one type are merged; other types are unchanged."""
    columns = Events.of([eFirst(1), eFirst(2), eFirst(1)])
    held = {"x": [columns, eAlone()], "y": [eFirst(3), eFirst(2)], "z": [Events.of([eFirst(4)])]}
    together, alone = collect(ORDER, held)
    assert isinstance(together, Events)
    assert list(together) == [eFirst(1), eFirst(2), eFirst(3), eFirst(4)]
    assert alone == eAlone()


def test_agents_of_different_shapes_stay_single():
    columns = Events.of([eFirst(1), eFirst(2)])
    mixed = collect(ORDER, {"x": [columns], "y": [eFirst(2), eFirst(3, receivers=["a", "b"])]})
    assert mixed == (eFirst(1), eFirst(2), eFirst(3, receivers=["a", "b"]))
    other = Events.of([eFirst(1, condition="x > 1")])
    assert collect(ORDER, {"x": [columns], "y": [other]}) == (*columns, *other)


def test_columns_of_one_row_lose_nothing():
    assert list(single(collect(ORDER, {"x": [Events.of([eLast("a")])]}))) == [eLast("a")]
