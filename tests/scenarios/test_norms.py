"""Norms, enforced at run time (section 1): permitted actions, places and frequencies."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from pond import Bus, host, service
from street import FINE, VOCABULARY, Light, Many, One, Passer, Steps, eFine, eShout, states, street

from minerva_bus import Generator
from minerva_bus.frame.messages import Emitted
from minerva_bus.frame.norm_rejections import PEOPLE
from minerva_bus.frame.stimuli import Abandoned, Publish
from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.events import single
from minerva_bus.grammar.scene import Scene
from minerva_bus.world.norms import SOURCE, Norm, Then
from tests.memory_bus import MemoryBus
from tests.one_process import run_world

KINDS = (One, Light, Passer)
SHOUT = replace(FINE, name="quiet", on=("eShout",))
FAR = np.arange(150) % 30 == 0
CROWD = One.many(
    "r", 150, x=np.where(FAR, 39.0, np.arange(150.0) / 10), speed=np.arange(150.0) / 50
)


def live(scene, norms, kinds=KINDS, hosts=1, frames=8, before=(), **rest):
    """Run a world; returns the events and strings of its frames, the algorithm and the figures."""
    members = {f"runners-{n}": host(f"runners-{n}", *kinds) for n in range(hosts)}
    members["steps"] = service("steps", Steps)
    lived = []
    runner = run_world(
        street(scene, norms, members, frames=frames, **rest),
        [make() for make in members.values()],
        lambda done, scene: lived.append((done.events, scene)),
        before,
    )
    return lived, runner.algorithm, runner.ended.figures


def happened(frames, event_type, sender=None):
    """Numbers of events of a type per frame, of one sender or of all."""
    return [
        sum(e.type == event_type and sender in (None, e.sender) for e in single(events))
        for events, _ in frames
    ]


# --- norms on events ---


def test_a_rejected_event_has_no_receivers():
    w = "ARunner#a · ARunner#b"
    without, _, _ = live(w, ())
    loud = Norm("loud", on=("eShout",), when="event.loud > 1.5")
    frames, _, figures = live(w, (loud,))
    refused = sum(
        event.loud > 1.5 for events, _ in without for event in events if event.type == "eShout"
    )
    assert refused > 2
    assert figures == {"norm_loud": refused}
    assert sum(happened(without, "eShout")) - sum(happened(frames, "eShout")) == refused
    assert all(
        event.loud <= 1.5 for events, _ in frames for event in events if event.type == "eShout"
    )
    heard = [
        sum(state["heard"] for state in states(run[-1][1]).values()) for run in (without, frames)
    ]
    assert heard[0] > heard[1]


def test_a_sanctioned_event_happens_and_its_sender_is_fined_in_the_next_frame():
    frames, _, _ = live("ARunner#a", (SHOUT,), frames=4)
    assert happened(frames, "eShout") == [0, 1, 1, 1]
    fines = [event for events, _ in frames for event in events if event.type == "eFine"]
    assert fines == [eFine(5, "fine", receivers=["a"])] * 2
    assert happened(frames, "eFine") == [0, 0, 1, 1]
    assert states(frames[-1][1])["a"]["fined"] == 10


@pytest.mark.parametrize(("applies", "boos"), [((), 0), (("steps",), 0), (("ARunner",), 4)])
def test_events_that_a_generator_may_send(applies, boos):
    norm = Norm("hush", applies, on=("eBoo",))
    frames, _, figures = live("APasser#p · ARunner#a", (norm,))
    assert sum(happened(frames, "eBoo")) == boos
    assert figures == ({} if boos else {"norm_hush": 4})


def test_events_that_people_may_send():
    order = Publish(eShout(1.0))
    for norms, count in (((), 1), ((Norm("n", (SOURCE[:0] + "~order",), on=("eShout",)),), 0)):
        frames, _, _ = live("APasser#p", norms, before=[order])
        assert sum(happened(frames, "eShout")) == count


def test_so_many_times_in_so_many_frames():
    """Shouts are sent in frames 1, 2, 3, ...; the norm allows two within three frames."""
    norm = Norm("seldom", on=("eShout",), most=2, per=3)
    frames, _, _ = live("ARunner#a", (norm,), frames=10)
    assert happened(frames, "eShout", "a") == [0, 1, 1, 0, 1, 1, 0, 1, 1, 0]
    allowed, _, _ = live("ARunner#a", (replace(norm, then=Then.COUNT),), frames=10)
    assert happened(allowed, "eShout", "a") == [0, *[1] * 9]


def test_how_often_is_each_ones_own():
    norm = Norm("once", on=("eShout",), most=1, per=100)
    frames, _, _ = live("ARunner#a · ARunner#b", (norm,), frames=5)
    assert happened(frames, "eShout", "a") == happened(frames, "eShout", "b") == [0, 1, 0, 0, 0]


# --- norms on new states of agents ---


def test_a_rejected_agent_stands_still_and_sends_nothing():
    w = "ARunner#a<speed=30> · ARunner#b<speed=-9>"
    frames, _, figures = live(w, (Norm("limit", when="speed > 20"),), frames=5)
    assert states(frames[-1][1])["a"] == states(VOCABULARY.read(w))["a"]
    assert states(frames[-1][1])["b"]["x"] < -20
    assert {event.sender for events, _ in frames for event in events if event.type == "eShout"} == {
        "b"
    }
    assert figures == {"norm_limit": 5}


def test_a_deleted_agent_has_no_state_for_conditions():
    norm = Norm("red", ("ARunner",), when="#light.green == false")
    frames, _, _ = live("ARunner#a", (norm,), frames=2)
    assert states(frames[-1][1])["a"]["x"]


def test_a_newborn_that_may_not_be_is_not_born_and_its_parent_stands_still():
    w = "ARunner#a<births=1, speed=-9>"
    free, _, _ = live(w, (), frames=20)
    assert len(states(free[-1][1])) > 1
    frames, _, figures = live(w, (Norm("young", when="births == 0"),), frames=20)
    assert {tuple(states(scene)) for _, scene in frames} == {("a",)}
    end = [states(scene)["a"] for _, scene in frames]
    assert {state["births"] for state in end} == {1}
    stood = sum(left["x"] == right["x"] for left, right in pairwise(end))
    assert 0 < stood == figures["norm_young"]


def test_an_agent_within_another_stands_still_with_it():
    w = "ARunner#a<speed=1>(ARunner#b<speed=30>)"
    frames, _, _ = live(w, (Norm("limit", when="speed > 20"),), frames=4)
    assert states(frames[-1][1]) == states(VOCABULARY.read(w))


def test_the_first_norm_that_refuses_leaves_nothing_for_the_others():
    norms = (Norm("one", when="speed > 20"), Norm("two", when="speed > 10"))
    assert live("ARunner#a<speed=30>", norms, frames=5)[2] == {"norm_one": 5}
    norms = (replace(norms[0], then=Then.COUNT), norms[1])
    assert live("ARunner#a<speed=30>", norms, frames=1)[2] == {"norm_one": 1, "norm_two": 1}


def test_it_is_reported_once():
    members = {"runners": host("runners", *KINDS), "steps": service("steps", Steps)}
    bus = Bus(street("ARunner#a<speed=30>", (Norm("limit", when="speed > 20"),)), members)
    bus.do("start, run")
    said = [line for line in bus.said if "limit" in line]
    assert len(said) == 1
    assert "limit is broken by #a in frame 0: refused" in said[0]


# --- the string does not depend on the hosts and on its representation ---

ALL = (
    Norm("limit", ("ARunner",), when="speed > 2.8 and was.speed < 2.8", sanction=eFine(2, "limit")),
    Norm("often", ("ARunner",), when="speed > 1.5", most=2, per=4),
    Norm("babies", when="births > 1", then=Then.SANCTION, sanction=eFine(9, "babies")),
    Norm("far", where="x >= 20 and x <= 30", when="#light.green == true", then=Then.COUNT),
    Norm("loud", on=("eShout",), when="event.loud > 2 or speed < 0", sanction=eFine(1, "loud")),
    Norm("seldom", ("ARunner",), on=("eShout",), most=2, per=5, then=Then.SANCTION,
         sanction=eFine(3, "seldom")),
)  # fmt: skip
STRING = CROWD + VOCABULARY.read("ALight#light")


def digests(run):
    return [scene.digest for _, scene in run[0]], run[2]


@pytest.fixture(scope="module")
def alone():
    run = live(STRING, ALL, (One, Light))
    assert set(run[2]) == {f"norm_{norm.name}" for norm in ALL}
    assert isinstance(run[1].scene.pieces[0], Columns)
    assert {":" in id for id in states(run[1].scene)} == {True, False}
    assert len([id for id in states(run[1].scene) if ":" not in id]) < 151
    return digests(run)


@pytest.mark.parametrize("hosts", [1, 2])
@pytest.mark.parametrize("form", [One, Many])
def test_one_by_one_is_all_at_once_on_any_number_of_hosts(alone, form, hosts):
    assert digests(live(STRING, ALL, (form, Light), hosts)) == alone


def test_a_few_that_are_no_columns_live_as_those_that_are():
    """This includes births; 20 agents stay separate nodes, 40 do not."""
    runs = []
    for count in (20, 40):
        crowd = One.many("r", count, x=np.arange(1.0 * count), speed=np.arange(1.0 * count) % 3)
        other = Norm("shouts", on=("eShout",))
        runs.append(live(Scene(crowd.nodes), (other, *ALL[:3]), (One, Light), frames=5)[0][-1][1])
    few, larger = map(states, runs)
    first = [id for id in larger if int(id[1:].split(":")[0]) < 20]
    assert {id: larger[id] for id in first} == few


def test_it_goes_on_from_any_frame(alone):
    members = {"runners-0": host("runners-0", One, Light), "steps": service("steps", Steps)}
    world = street(STRING, ALL, members)
    for stop in (2, 5):
        bus = Bus(world, members).do("start")
        bus.run(stop)
        checkpoint = bus.algorithm.checkpoint
        again = Bus(replace(world, scene=bus.algorithm.scene, past=checkpoint), members)
        again.do("start, run")
        assert again.digests == [digest.hex() for digest in alone[0]][stop:]
        assert again.ended.figures == alone[1]


def test_another_coordinator_goes_on_from_the_journal(alone):
    members = {"runners-0": host("runners-0", One, Light), "steps": service("steps", Steps)}
    bus = Bus(street(STRING, ALL, members), members).do("start, run 5, kill_coordinator, run")
    assert bus.digests[-1] == alone[0][-1].hex()
    assert bus.ended.figures == alone[1]


def test_a_host_that_dies_changes_nothing(alone):
    members = {"runners-0": host("runners-0", One, Light), "steps": service("steps", Steps)}
    bus = Bus(street(STRING, ALL, members), members).do("start")
    for _ in range(3):
        bus.run(2)
        bus.restart("runners-0")
    bus.run()
    assert bus.digests == [digest.hex() for digest in alone[0]]


# --- people ---


class Passes(Generator, events=("eShout",)):
    """Takes orders to shout, and shouts twice as loud."""

    def takes_orders(self):
        return self.events

    def generate(self, tick):
        return [eShout(2 * order.loud) for order in tick.orders]


class Keys(Generator, events=("eShout",), when="freely"):
    """Input by hand."""

    people = True


HUSH = Norm("hush", (PEOPLE,), on=("eShout",), when="event.loud > 5")


def ordered(members, orders, norms=(HUSH,), expected=None, emitted=(), end=None):
    """The shouts of a world after orders of people, and the bus.

    `end`: how the members that have emitted events leave before these count.
    """
    members = {"steps": service("steps", Steps), "runners": host("runners", *KINDS), **members}
    bus = Bus(street("APasser#p", norms, expected or members, frames=0), members).do("start, run 1")
    for event in orders:
        bus.handle(event if isinstance(event, Publish) else Publish(event))
    for name, event in emitted:
        bus.handle(Emitted(name, (event,)))
        if end is not None:
            end(bus, name)
            bus.settle()
    bus.run(2)
    return [
        str(e) for record in bus.records for e in single(record.events) if e.type == "eShout"
    ], bus


@pytest.mark.parametrize("through", [{}, {"passes": service("passes", Passes)}])
def test_a_norm_for_one_person_leaves_the_orders_of_others(through):
    norm = Norm("hush", (f"{PEOPLE}:anna",), on=("eShout",))
    orders = [Publish(eShout(4.0), "anna"), Publish(eShout(5.0), "bert"), Publish(eShout(6.0))]
    shouts, bus = ordered(through, orders, [norm])
    factor = 2 if through else 1
    # In the order of their sources: people without a name come first.
    assert shouts == [f"eShout<loud={factor * loud}>" for loud in (6, 5)]
    assert bus.algorithm.norms.broken == {"hush": 1}
    assert any("hush is broken by anna in frame 1" in line for line in bus.trace)
    fates = [line for line in bus.trace if "counts in frame 1" in line]
    assert ["of bert" in fate for fate in fates] == ["of people" not in fate for fate in fates]


def test_a_norm_for_people_covers_what_a_generator_takes():
    passes = {"passes": service("passes", Passes)}
    shouts, bus = ordered(passes, [eShout(4.0), eShout(5.5)])
    assert shouts == ["eShout<loud=8>"]
    assert bus.algorithm.norms.broken == {"hush": 1}
    assert any("hush is broken by people in frame 1" in line for line in bus.trace)
    own = replace(HUSH, applies=("passes",))
    assert ordered(passes, [eShout(2.0), eShout(4.0)], (own,))[0] == ["eShout<loud=4>"]


def test_a_norm_for_people_covers_keys_and_attached_members():
    keys = {"keys": service("keys", Keys)}
    orders = [("keys", eShout(1.0)), ("keys", eShout(9.0))]
    assert ordered(keys, [], emitted=orders)[0] == ["eShout<loud=1>"]

    class Guest(Keys):
        people = False

    guest = {"keys": service("keys", Guest)}
    assert ordered(guest, [], emitted=orders)[0] == ["eShout<loud=1>", "eShout<loud=9>"]
    attached = {"expected": ("steps", "runners"), "emitted": orders}
    assert ordered(guest, [], **attached)[0] == ["eShout<loud=1>"]
    of = {name: replace(HUSH, applies=(f"{PEOPLE}:{name}",)) for name in ("keys", "anna")}
    assert ordered(guest, [], [of["keys"]], **attached)[0] == ["eShout<loud=1>"]
    assert len(ordered(guest, [], [of["anna"]], **attached)[0]) == 2


@pytest.mark.parametrize("end", [MemoryBus.leave, MemoryBus.vanish])
@pytest.mark.parametrize("expected", [None, ("steps", "runners")])
def test_who_leaves_before_an_order_counts_is_still_a_person(end, expected):
    def gone(bus, name):
        end(bus, name)
        if expected is None:  # Its process is not restarted either.
            bus.settle()
            bus.handle(Abandoned(name))

    keys = {"keys": service("keys", Keys)}
    loud = [("keys", eShout(9.0))]
    shouts, bus = ordered(keys, [], emitted=loud, expected=expected, end=gone)
    assert shouts == []
    assert bus.algorithm.norms.broken == {"hush": 1}
    assert bus.inputs[1].people == ("keys",)


def test_a_successor_knows_what_people_may_not_send():
    """It judges orders and keys again, although no generator that took them is present."""
    members = {"passes": service("passes", Passes), "keys": service("keys", Keys)}
    _, bus = ordered(members, [eShout(4.0), eShout(5.5)], emitted=[("keys", eShout(7.0))])
    before = bus.algorithm
    bus.kill_coordinator()
    assert bus.algorithm is not before
    assert bus.algorithm.norms.broken == before.norms.broken == {"hush": 2}
    assert bus.algorithm.checkpoint == before.checkpoint
    assert bus.algorithm.scene.digest == before.scene.digest


@pytest.mark.parametrize("steps", range(8))
def test_an_order_that_is_handed_over_is_obeyed_once_whenever_the_coordinator_dies(steps):
    members = {"steps": service("steps", Steps), "runners": host("runners", *KINDS)}
    members["passes"] = service("passes", Passes)
    bus = Bus(street("ARunner#r<speed=-9>", (HUSH,), members, frames=0), members).do("start, run 1")
    bus.handle(Publish(eShout(4.0)))
    for _ in range(steps):
        bus.step(bus.ready()[0])
    waits, whole = bus.algorithm.ordered, len(bus.records)
    bus.kill_coordinator()
    if waits:
        bus.algorithm.inbox.replace(waits)
    bus.settle()
    bus.run(3)
    shouts = [e.loud for record in bus.records for e in single(record.events) if e.type == "eShout"]
    assert shouts.count(8.0) == 1, whole
