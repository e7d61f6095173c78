"""Methods of one agent that take all events of a type in one call."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from minerva_bus import Agent, EventBatch, Events, EventType, Frame, Policy, evolve, on
from minerva_bus.grammar.column import Column
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.packing import one_by_one
from minerva_bus.world.addressing import Addressed

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


def scan(receivers, dist):
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
            yield scan([f"a{row}" for row, _ in item], [dist for _, dist in item])
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
    events = [scan(["a0", "a1", "a0"], [1.0, 2.0, 3.0]), eHit(4.0), eHit(5.0, receivers=("a0",))]
    result = evolve(shape(Batch.many("a", 2)), events, [Batch]).scene
    assert [node.state["calls"] for node in result] == [1, 1]
    assert [node.state["total"] for node in result] == [0.25 / 2 + 1.5 / 2 + 4 / 2 + 5, 5.0]


def test_an_agent_with_other_than_scalars_gets_batches_too():
    events = [scan(["g", "b", "g"], [1.0, 2.0, 3.0]), eHit(4.0)]
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
    events = [scan(["a"], [1.0]), eTurn(), scan(["a", "a"], [1.0, 2.0])]
    assert totals(Single, scene, events) == [1.5 - 3.0]


def test_a_copy_of_the_literal_policy_gets_a_batch_of_one():
    events = [scan(["g", "g"], [1.0, 2.0])]
    result = evolve(Grid("g").string, events, [Grid], Frame(1), Policy.LITERAL).scene
    assert [node.state["path"] for node in result] == [(1.0, -1.0), (2.0, -1.0)]


def test_an_override_without_a_mark_gets_single_events():
    class Plain(Batch, symbol="ASensor"):
        def hit(self, hit, moment):
            self.total += hit.dist

    assert totals(Plain, Plain("a").string, [scan(["a", "a"], [1.0, 2.0])]) == [3.0]


def test_a_missing_datum_lists_those_of_the_event():
    batch = EventBatch(scan(["a"], [1.0]))
    with pytest.raises(AttributeError, match="eHit has no angle; it has dist"):
        _ = batch.angle


def test_the_only_receiver_of_a_batch_gets_the_batch_itself():
    batch, others = scan(["a1"] * 5, range(5)), scan(["a1", "a2", "a2"], [5, 6, 7])
    events = Addressed((batch, others))
    (_, whole), (index, event) = events.to("a1", {"eHit"})
    assert whole is batch
    assert (index, event.dist) == (1, 5.0)
    ((_, rest),) = events.to("a2", {"eHit"})
    assert rest.data("dist").tolist() == [6.0, 7.0]
    assert events.to("a3", {"eHit"}) == []
