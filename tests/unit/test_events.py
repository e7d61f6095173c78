"""Events as values, as rows, and in batches that a method takes in one call."""

import copy
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from minerva_bus import (
    Agent,
    Cells,
    Event,
    EventBatch,
    EventType,
    Frame,
    Policy,
    Primitive,
    Reals,
    Scene,
    Vocabulary,
    evolve,
    on,
    parse,
)
from minerva_bus.errors import VocabularyError
from minerva_bus.grammar.columns import Column, one_by_one
from minerva_bus.grammar.events import Events, as_batch, first_of, in_columns, single
from minerva_bus.grammar.ids import Ids
from minerva_bus.world.event_collection import Addressed

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


eHit = EventType("eHit", dist=float)
eTurn = EventType("eTurn")


class Single(Agent, symbol="ASensor"):
    calls: int = 0
    total: float = 0.0

    @on("eHit")
    def hit(self, hit, moment):
        self.total = self.total * 0.5 + hit.dist

    @on("eTurn")
    def turn(self, event, moment):
        return Other(self.id, total=self.total).string


class Batch(Single, symbol="ASensor"):
    @on("eHit", together=True, population=False)
    def hit(self, hit, moment):
        self.calls += 1
        for dist in hit.dist.tolist():
            self.total = self.total * 0.5 + dist


class Other(Agent, symbol="AOther"):
    total: float = 0.0

    @on("eHit", together=True, population=False)
    def hit(self, hit, moment):
        self.total -= float(hit.dist.sum())


class Grid(Agent, symbol="ASensor"):
    """It has an attribute that is not scalar, so it cannot be a row of columns."""

    path: tuple[float, ...] = ()

    @on("eHit", together=True, population=False)
    def hit(self, hit, moment):
        assert isinstance(hit, EventBatch)
        assert hit.row.tolist() == [0] * len(hit)
        self.path = (*self.path, *(event.dist for event in hit), -1.0)


class Doubtful(Single, symbol="ASensor"):
    @on("eHit", together=True, population=False, probability=0.5)
    def hit(self, hit, moment):
        for dist in hit.dist.tolist():
            self.total = self.total * 0.5 + dist


class DoubtfulOneByOne(Single, symbol="ASensor"):
    @on("eHit", probability=0.5)
    def hit(self, hit, moment):
        self.total = self.total * 0.5 + hit.dist


def scan_of(receivers, dist):
    column = Column(np.array(dist, np.float64))
    return Events("eHit", ("dist",), (column,), len(dist), receivers=Ids.of(receivers))


def totals(cls, scene, events):
    return [node.state["total"] for node in evolve(scene, events, [cls, Other], Frame(3)).scene]


hits = st.lists(
    st.one_of(
        st.lists(st.tuples(st.integers(0, 3), st.integers(0, 9)), min_size=1, max_size=6),
        st.tuples(st.integers(-1, 3), st.integers(0, 9)),
    ),
    min_size=1,
    max_size=4,
)


def events_of(items):
    """Batches to several agents, single events to one, or (-1) to all."""
    for item in items:
        if isinstance(item, list):
            yield scan_of([f"a{row}" for row, _ in item], [dist for _, dist in item])
        else:
            to = (f"a{item[0]}",) if item[0] >= 0 else ()
            yield eHit(float(item[1]), receivers=to)


@pytest.mark.parametrize(("batch", "single"), [(Batch, Single), (Doubtful, DoubtfulOneByOne)])
@settings(max_examples=40)
@given(items=hits)
def test_a_batch_is_its_events_in_order(batch, single, items):
    events = list(events_of(items))
    expected = totals(single, single.many("a", 4), events)
    members = batch.many("a", 4)
    assert totals(batch, members, events) == expected
    assert totals(batch, one_by_one(members), events) == expected


@pytest.mark.parametrize("shape", [lambda scene: scene, one_by_one])
def test_all_events_of_a_type_arrive_in_one_call(shape):
    events = [scan_of(["a0", "a1", "a0"], [1.0, 2.0, 3.0]), eHit(4.0), eHit(5.0, receivers=("a0",))]
    result = evolve(shape(Batch.many("a", 2)), events, [Batch]).scene
    assert [node.state["calls"] for node in result] == [1, 1]
    assert [node.state["total"] for node in result] == [0.25 / 2 + 1.5 / 2 + 4 / 2 + 5, 5.0]


def test_an_agent_with_other_than_scalars_gets_batches_too():
    events = [scan_of(["g", "b", "g"], [1.0, 2.0, 3.0]), eHit(4.0)]
    result = evolve(Grid("g").string, events, [Grid]).scene
    assert result.nodes[0].state["path"] == (1.0, 3.0, 4.0, -1.0)


def test_events_of_different_forms_arrive_in_order_in_several_calls():
    sent = eHit(2.0, sender="b", receivers=("g",))
    result = evolve(Grid("g").string, [eHit(1.0), sent], [Grid]).scene
    assert result.nodes[0].state["path"] == (1.0, -1.0, 2.0, -1.0)


def test_a_condition_holds_for_the_state_before_the_batch():
    at_rest = eHit(2.0, condition="total == 0")
    assert totals(Batch, Batch("a").string, [at_rest]) == [2.0]
    assert totals(Batch, Batch("a", total=1.0).string, [at_rest]) == [1.0]


def test_another_kind_gets_the_events_that_follow():
    scene = Single("a", total=1.0).string
    events = [scan_of(["a"], [1.0]), eTurn(), scan_of(["a", "a"], [1.0, 2.0])]
    assert totals(Single, scene, events) == [1.5 - 3.0]


def test_a_copy_of_the_literal_policy_gets_a_batch_of_one():
    events = [scan_of(["g", "g"], [1.0, 2.0])]
    result = evolve(Grid("g").string, events, [Grid], Frame(1), Policy.LITERAL).scene
    assert [node.state["path"] for node in result] == [(1.0, -1.0), (2.0, -1.0)]


def test_an_override_without_a_mark_gets_single_events():
    class Plain(Batch, symbol="ASensor"):
        def hit(self, hit, moment):
            self.total += hit.dist

    assert totals(Plain, Plain("a").string, [scan_of(["a", "a"], [1.0, 2.0])]) == [3.0]


def test_a_missing_datum_lists_those_of_the_event():
    batch = EventBatch(scan_of(["a"], [1.0]))
    with pytest.raises(AttributeError, match="eHit has no angle; it has dist"):
        _ = batch.angle


def test_the_only_receiver_of_a_batch_gets_the_batch_itself():
    batch, others = scan_of(["a1"] * 5, range(5)), scan_of(["a1", "a2", "a2"], [5, 6, 7])
    events = Addressed((batch, others))
    (_, whole), (index, event) = events.to("a1", {"eHit"})
    assert whole is batch
    assert (index, event.dist) == (1, 5.0)
    ((_, rest),) = events.to("a2", {"eHit"})
    assert rest.data("dist").tolist() == [6.0, 7.0]
    assert events.to("a3", {"eHit"}) == []
