"""An event has the interface of a batch with one row."""

from hypothesis import given
from hypothesis import strategies as st

from minerva_bus import EventType
from minerva_bus.grammar.batch import as_batch, first_of, single

eCount = EventType("eCount", n=int)


@given(st.lists(st.integers(-5, 5), min_size=1, max_size=6))
def test_an_event_counts_and_iterates_as_a_batch_of_one(values):
    events = [eCount(value) for value in values]
    assert [len(event) for event in events] == [1] * len(events)
    assert list(single(events)) == events
    batches = [as_batch(event) for event in events]
    assert [len(batch) for batch in batches] == [1] * len(events)
    assert list(single(batches)) == events
    assert [first_of(batch) for batch in batches] == events
