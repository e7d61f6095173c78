"""Equation 6 for columns of events: the collection equals that of the single events."""

from __future__ import annotations

from itertools import groupby

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from minerva_bus import Agent, EventType, Generator, World, on, service
from minerva_bus import run as run_world
from minerva_bus.grammar.events import Event, Events, single
from minerva_bus.world.event_collection import Priority, collect

eFirst = EventType("eFirst", n=int)
eLast = EventType("eLast", name=str)
eAlone = EventType("eAlone")
ORDER = Priority(("eLast", "eFirst"))

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


def test_events_of_different_forms_stay_in_their_batches():
    """One event of another form would otherwise make an object of each event of a batch."""
    columns = Events.of([eFirst(1), eFirst(2)])
    to_both = eFirst(3, receivers=["a", "b"])
    to_a = Events.of([eFirst(2, receivers=["a"]), eFirst(1, receivers=["a"])])
    sources = {"x": [columns, to_both, to_a], "y": [to_both, columns, eFirst(4), to_a.event(0)]}
    collected = collect(ORDER, sources)
    assert list(single(collected)) == [*columns, to_both, *to_a, eFirst(4)]
    assert [len(part) for part in collected if isinstance(part, Events)] == [2, 2, 1]


def test_single_events_beside_batches_of_another_form_become_batches():
    def made(value):
        return Event("eAny", ("value",), (value,), receivers=("a",))

    to_all = Events.of([Event("eAny", ("value",), (n,)) for n in range(3)])
    alone = [made(1), made(2), made((1.0, 2.0)), made(3), made(4)]  # A list is in no column.
    collected = collect(ORDER, {"x": [to_all], "y": alone})
    assert list(single(collected)) == [*to_all, *alone]
    assert [len(part) if isinstance(part, Events) else 0 for part in collected] == [3, 2, 0, 2]


def test_batches_whose_columns_have_other_types_are_collected_once():
    def made(value):
        return Event("eAny", ("value",), (value,), receivers=("a",))

    numbers, texts = Events.of([made(1), made(2)]), Events.of([made("x"), made("y")])
    collected = collect(ORDER, {"x": [numbers, texts, made(1)], "y": [texts, numbers]})
    assert list(single(collected)) == [made(1), made(2), made("x"), made("y")]
    # An event with a list has no columns, so its form is none of a batch.
    listed = made((1.0, 2.0))
    collected = collect(ORDER, {"x": [numbers, listed, made(3)], "y": [listed, numbers]})
    assert list(single(collected)) == [made(1), made(2), listed, made(3)]


class Mixed(Generator, events=("eFirst",)):
    """Events of several forms, in batches or as single ones."""

    def __init__(self, batches: bool = True) -> None:
        self.batches = batches

    def generate(self, tick):
        sent = [
            *[eFirst(n, receivers=[f"f{n % 7}"]) for n in range(20)],
            eFirst(50),
            *[eFirst(n, receivers=[f"f{n % 3}"]) for n in range(15, 30)],
            eFirst(60, receivers=["f1", "f2"]),
            eFirst(50),
        ]
        return in_columns(sent, lambda at: at // 10) if self.batches else sent


class Adder(Agent, symbol="AAdder"):
    total: int = 0
    calls: int = 0

    @on("eFirst")
    def add(self, event, moment):
        self.total = 3 * self.total + event.n + int(moment.random.integers(5))
        self.total %= 1_000_003


class Crowd(Agent, symbol="ACrowd"):
    total: int = 0

    @on("eFirst", population=True)
    def add(crowd, event, moment):
        crowd.total = (3 * crowd.total + event.n) % 1_000_003


@pytest.mark.parametrize("kind", [Adder, Crowd])
@pytest.mark.parametrize(
    "string", ["{}#f1 · {}#f2 · {}#g", " · ".join(f"{{0}}#f{n}" for n in range(40))]
)
def test_agents_evolve_equally_by_batches_of_several_forms(kind, string):
    text = string.replace("{0}", "{}").replace("{}", kind.kind.name)
    digests = set()
    for batches in (False, True):
        services = [service(Mixed, batches=batches)]
        world = World(text, agents=[kind], services=services, symbols=[eFirst], name="mixed")
        digests.add(run_world(world, frames=3).digest)
    assert len(digests) == 1


def test_columns_of_one_row_lose_nothing():
    assert list(single(collect(ORDER, {"x": [Events.of([eLast("a")])]}))) == [eLast("a")]


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
