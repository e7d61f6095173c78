"""An event has the interface of a batch with one row."""

from hypothesis import given
from hypothesis import strategies as st

from minerva_bus import EventType
from minerva_bus.grammar.batch import Events, as_batch, first_of, in_columns, single

eCount = EventType("eCount", n=int)
eWay = EventType("eWay", lengths=tuple[float, ...])


@given(st.lists(st.integers(-5, 5), min_size=1, max_size=6))
def test_an_event_counts_and_iterates_as_a_batch_of_one(values):
    events = [eCount(value) for value in values]
    assert [len(event) for event in events] == [1] * len(events)
    assert list(single(events)) == events
    batches = [as_batch(event) for event in events]
    assert [len(batch) for batch in batches] == [1] * len(events)
    assert list(single(batches)) == events
    assert [first_of(batch) for batch in batches] == events


def test_the_events_for_one_agent():
    for_all = Events.of([eCount(1), eCount(2)])
    assert for_all.to("a") is for_all
    both = Events.of([eCount(n, receivers=[to]) for n, to in enumerate(["a", "b", "a"])])
    assert list(both.to("a")) == [eCount(0, receivers=["a"]), eCount(2, receivers=["a"])]
    assert list(both.to("c")) == []


def test_copies_have_the_receiver_of_the_event():
    for receivers in [(), ("a",)]:
        event = eCount(3, receivers=receivers)
        assert list(as_batch(event, 2)) == [event, event]


def test_more_events_than_a_thousand_travel_in_columns():
    few = tuple(map(eCount, range(1_000)))
    assert in_columns(few) is few
    last = eCount(1_000)
    batch = Events.of([eCount(-1), eCount(-2)])
    way, other = eWay([1.0, 2.0]), eWay([3.0])
    first, second, third, *ways = in_columns((way, *few, batch, last, other))
    assert (len(first), second, len(third)) == (1_000, batch, 1)
    assert [*single([first, third])] == [*few, last]
    assert ways == [way, other]
