"""Events that cost hosts more than their sender: weighed on arrival, and left out if a host ends."""

import re

import numpy as np
import pytest
from pond import (
    VOCABULARY,
    Add,
    Counter,
    Lily,
    Minnow,
    Mother,
    Steps,
    eAdd,
    eCroak,
    host,
    service,
    world,
)

from minerva_bus import EMPTY, Event, Generator, on
from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.composition import Composition
from minerva_bus.frame.sender_rights import EventWork
from minerva_bus.grammar.events import Events, single
from minerva_bus.grammar.ids import Ids
from minerva_bus.world.norms import Norm, Then
from tests.memory_bus import MemoryBus

LONG = " or ".join(["n < 0"] * 300)
"""A condition of 2,696 characters, which the work of 338 events is."""

MANY = f"ALily#l({' · '.join(f'ACounter#c{n}' for n in range(250))})"


class Guest(Generator, events=("eAdd", "eCroak"), when="freely"):
    pass


def crowd():
    """A world of 250 counters, and of 1,000 minnows in columns; a guest may send events."""
    w = world(MANY, ()).scene + Minnow.many("m", 1_000)
    members = {"host": host("host", Counter, Lily, Minnow), "steps": service("steps", Steps)}
    bus = MemoryBus(world(w, members), {**members, "guest": service("guest", Guest)})
    bus.start()
    bus.run(1)
    return bus


def many(event, count, receivers=None):
    return Events(
        event.type, event.names, Events.repeated(event, count).columns, count, "", None, receivers
    )


HEAVY = {
    "conditions": ([eAdd(n, condition=f"n < {n} or {LONG}") for n in range(6)], "eAdd, delivered 250 times with a condition"),
    "a condition of columns": ([eCroak(0.0, condition=LONG.replace("n <", "x <"))] * 80, "eCroak, delivered .* times"),
    "events for all": ([many(eAdd(1), 3_000)], "eAdd, delivered 750,000 times"),
    "events for a population": ([many(eCroak(1.0), 40_000)], "eCroak, delivered .* times"),
    "events for one of many": ([many(eCroak(1.0), 60_000, Ids.of(["m1"] * 60_000))], "eCroak, delivered .* times"),
    "a condition for one": ([Events.repeated(eAdd(1, condition=LONG, receivers=["c1"]), 2_000)], "eAdd, delivered 2,000 times"),
}  # fmt: skip


@pytest.mark.parametrize("how", HEAVY)
def test_events_that_cost_hosts_too_much_are_refused(how):
    bus, (events, heaviest) = crowd(), HEAVY[how]
    bus.put(m.Emitted("guest", tuple(events)))
    bus.settle()
    (said,) = bus.said
    assert said.startswith("guest: broke the protocol: events weigh ")
    assert re.search(f"over 2000: the heaviest is {heaviest}", said)


def test_heavy_events_wait_for_later_frames_and_fill_the_queue():
    """Each event counts as 339 of the 2,000 of a frame."""
    bus = crowd()
    for n in range(7):
        bus.put(m.Emitted("guest", (eAdd(n, condition=f"n >= {n} or {LONG}"),)))
    bus.settle()
    frames = []
    for _ in range(3):
        bus.run(1)
        frames.append([event.n for event in single(bus.records[-1].events) if event.type == "eAdd"])
    assert frames == [[0, 1, 2, 3, 4], [5, 6], []]
    for _ in range(300):
        bus.put(m.Emitted("guest", (eAdd(1, condition=LONG),)))
    bus.settle()
    assert bus.algorithm.members.get("guest").dropped == 5


def test_the_events_of_a_host_and_the_orders_of_a_person_are_weighed_too():
    bus = crowd()
    algorithm, order = bus.algorithm, eAdd(1, condition=LONG)
    for _ in range(5):
        assert not algorithm.inbox.too_much_work(order, "ann")
        bus.handle(s.Publish(order, "ann"))
    assert "over 2000: the heaviest is eAdd" in algorithm.inbox.too_much_work(order, "ann")
    assert not algorithm.inbox.too_much_work(order, "bob")
    bus.hold(("down", "host"))
    bus.frame()
    sent = tuple(eAdd(1, condition=LONG, sender="c1") for _ in range(24))
    bus.put(m.EvolveReply("host", 1, 0, {}, {"c1": sent}))
    bus.settle()
    assert "host: broke the protocol: events weigh 8136" in bus.said[-1]


def test_large_data_weigh_too():
    values = "x" * 40_000, (("y" * 9_000, 1.0), "z" * 9_000), np.zeros((1_000, 10))
    event = Event("eData", ("text", "list", "matrix"), values)
    assert (
        EventWork(Composition(EMPTY), VOCABULARY).weight(event) == 1 + (58_008 + 80_000) // 32_768
    )


def test_a_batch_weighs_the_same_if_it_shares_the_ids_of_the_string():
    composition = Composition(Minnow.many("m", 5_000))
    work = EventWork(composition, VOCABULARY)
    (own,) = [part.ids for part in composition.parts.values()]
    equal = Ids.of(own.texts())
    assert own is not equal
    shared, searched = (work.weight(many(eCroak(1.0), 5_000, ids)) for ids in (own, equal))
    assert shared == searched > 1
    assert composition.first_missing(own) is composition.first_missing(equal) is None


# --- a frame that ends a host ---


class Fragile(Counter, symbol="ACounter"):
    """Ends its process by a large number."""

    @on("eAdd")
    def add(self, add, moment):
        if add.n == 10:
            raise MemoryError
        super().add(add, moment)


NORM = Norm("few", on=("eAdd",), when="event.n > 0", then=Then.COUNT)


def fragile(*events, orders=(), sinks=()):
    """A frame with events of guests and people, after which the host of `#a` has ended once."""
    members = {
        "host": host("host", Fragile),
        "mothers": host("mothers", Mother),
        "add": service("add", Add),
    }
    made = world("ACounter#a · AMother#m", members, norms=(NORM,))
    bus = MemoryBus(made, {**members, "guest": service("guest", Guest)}, sinks)
    bus.start()
    bus.run(1)
    for order in orders:
        bus.handle(s.Publish(order, "anna"))
    bus.put(m.Emitted("guest", events))
    bus.settle()
    bus.frame()
    return bus


def test_events_of_guests_are_left_out_of_a_frame_that_ends_a_host_twice():
    bus = fragile(eAdd(10), eAdd(5))
    assert "host" not in bus.alive
    bus.appear("host")
    bus.settle()
    assert "host" not in bus.alive
    assert len(bus.records) == 1
    said = next(said for said in bus.said if "twice" in said)
    assert said == (
        "host: its process ended twice in frame 1, perhaps by too many events: the heaviest is eAdd,"
        " delivered 3 times, from guest; the frame is repeated without the events of guest"
    )
    assert bus.algorithm.members.get("guest").dropped == 2
    bus.appear("host")
    bus.run(1)
    # All agents have evolved by the event of `add` alone, also those that had answered before.
    state = str(bus.algorithm.scene)
    assert state.startswith("ACounter#a<n=3>() · AMother#m<births=3>() · ACounter#m:3<n=1>()")
    assert [event.n for event in single(bus.records[1].events)] == [1]
    digests, broken = bus.digests, dict(bus.algorithm.norms.broken)
    assert broken == {"few": 5}
    bus.kill_coordinator()
    assert bus.algorithm.scene.digest.hex() == digests[-1]
    assert bus.algorithm.norms.broken == broken
    bus.run(1)
    assert len(bus.records) == 4


def test_orders_that_are_left_out_of_a_frame_are_dropped():
    orders, judged = (eAdd(10), eAdd(5)), []
    bus = fragile(orders=orders, sinks=[judged.append])
    bus.appear("host")
    bus.settle()
    bus.appear("host")
    bus.run(1)
    assert [notice for notice in judged if isinstance(notice, s.OrderJudged)] == [
        *(s.OrderJudged(order, "anna", 1) for order in orders),
        *(s.OrderJudged(order, "anna", 1, "dropped", "host") for order in orders),
    ]
    assert (
        "orders: eAdd<n=10> of anna counts no more in frame 1, which ended host twice" in bus.said
    )


def test_a_frame_that_ends_a_host_without_guests_names_its_heaviest_event():
    bus = fragile()
    bus.hold(("up", "host"))
    bus.frame()
    bus.vanish("host")
    bus.settle()
    bus.appear("host")
    bus.settle()
    for _ in range(2):  # the late answer of the first process, the hello of the second
        bus.step(("up", "host"))
        bus.settle()
    bus.vanish("host")
    bus.settle()
    assert (
        "host: its process ended twice in frame 2, perhaps by too many events: the heaviest is eAdd,"
        " delivered 4 times, from add; the frame is tried again as it is" in bus.said
    )


def test_a_frame_that_ends_a_host_by_a_known_error_names_no_event():
    bus = fragile()
    bus.makers["add"] = service("add", lambda: Add(10))
    bus.restart("add")
    bus.run(1)
    bus.appear("host")
    bus.settle()
    assert sum("MemoryError" in said for said in bus.said) == 2
    assert not any("twice" in said for said in bus.said)
