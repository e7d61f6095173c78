"""Equal events in columns count once, like single events (equation 6)."""

from hypothesis import given
from hypothesis import strategies as st

from minerva_bus import EventType
from minerva_bus.grammar.batch import Events

eMany = EventType("eMany", x=float, n=int, told=bool, text=str)
eBare = EventType("eBare")
FEW = st.builds(
    eMany,
    st.sampled_from([0.0, -0.0, 1.5]),
    st.integers(-1, 1),
    st.booleans(),
    st.sampled_from(["", "ä"]),
    receivers=st.sampled_from([["a"], ["b1"]]),
)


@given(st.lists(FEW, min_size=1, max_size=60))
def test_each_is_kept_where_it_is_first(events):
    batch = Events.of(events)
    assert batch is not None
    assert list(batch.distinct()) == list(dict.fromkeys(events))


def test_a_million_equal_events_are_one():
    """A comparison row by row takes five seconds."""
    assert list(Events.repeated(eBare(), 1_000_000).distinct()) == [eBare()]
    event = eMany(1.0, 2, True, "x")
    assert list(Events.repeated(event, 1_000_000).distinct()) == [event]
