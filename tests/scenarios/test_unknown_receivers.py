"""Events for agents that have never been in the string are reported, once for each type."""

from dataclasses import replace

import pytest
from pond import VOCABULARY, Add, counters, eAdd, eDone, eStep, service

from minerva_bus.frame.composition import Composition
from minerva_bus.frame.sender_rights import UnknownReceivers
from minerva_bus.grammar.events import as_batch
from minerva_bus.grammar.ids import Ids


class Misspelt(Add):
    def generate(self, tick):
        return [eAdd(1, receivers=["aa"]), eAdd(2, receivers=["b"])]


def said(bus):
    lines = "\n".join(bus.trace).splitlines()
    return [line for line in lines if "does not have" in line]


def test_an_unknown_receiver_is_reported_once():
    bus = counters(members={"add": service("add", Misspelt)}).do("start, run 3")
    assert len(said(bus)) == 1
    problem = "eAdd goes to an agent that the string does not have: #aa; did you mean 'a'?"
    assert problem in said(bus)[0]


def string(*ids):
    return VOCABULARY.read(" · ".join(f"ACounter#{agent_id}" for agent_id in ids))


def problems(events, now=("a", "b"), first=("a", "b", "dead")):
    return list(UnknownReceivers(string(*first)).problems(events, Composition(string(*now))))


def test_agents_that_have_died_are_no_mistake():
    """Their ids are those of the first string, or derive from them."""
    assert problems([eAdd(1, receivers=["dead", "dead:3", "dead:7-2:1", "a:4"])]) == []
    assert problems([eAdd(1, receivers=["deadly:3"])])
    assert problems([eAdd(1, receivers=["dea"])])


def test_events_for_all_or_for_agents_in_the_string_are_not_reported():
    assert problems([eAdd(1), eAdd(1, receivers=["a", "b"]), eDone()]) == []


def test_each_type_is_reported_once_with_its_sender():
    events = [
        eAdd(1, receivers=["x1"], sender="a"),
        eAdd(1, receivers=["x2"]),
        eStep(1, receivers=["x3"]),
    ]
    unknown, now = UnknownReceivers(string("a")), Composition(string("a"))
    lines = list(unknown.problems(events, now))
    assert [line.split(" goes ")[0] for line in lines] == ["eAdd of #a", "eStep"]
    assert list(unknown.problems(events, now)) == []


def test_a_batch_is_compared_too():
    batch = as_batch(eAdd(1), 3)
    to = Ids.of(["a", "b", "nobody"])
    assert len(problems([replace(batch, receivers=to)])) == 1
    assert problems([replace(batch, receivers=Ids.of(["a", "b", "dead:1"]))]) == []


@pytest.mark.parametrize(
    ("event", "reason"),
    [
        (eAdd(1), ""),
        (eAdd(1, receivers=["a"]), ""),
        (eDone(), "no agent kind of this world responds to eDone"),
        (eStep(1, receivers=["a"]), "no ACounter responds to eStep; AFrog, ALily, AMinnow does"),
    ],
)
def test_an_order_that_changes_nothing_has_a_note(event, reason):
    bus = counters(members={})
    bus.start()
    assert bus.algorithm.orders.without_effect(event) == reason
