"""Replies that are late, from the wrong member, or about fragments of others."""

import pytest
from pond import (
    VOCABULARY,
    Counter,
    Frog,
    Minnow,
    Screen,
    Steps,
    eAdd,
    eCroak,
    eDone,
    host,
    service,
    started,
    world,
)

from minerva_bus import Generator
from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.member_table import MemberState
from minerva_bus.grammar.columns import Delta, difference
from tests.memory_bus import BEGIN, MemoryBus


def member(bus, name):
    return bus.algorithm.members.get(name)


@pytest.mark.parametrize("frame", [0, 2, 99, 1 << 60])
def test_an_answer_to_another_tick_is_dropped_and_counted(frame):
    bus = started()
    bus.step(BEGIN)
    bus.put(m.TickReply("add", frame, (eAdd(50),)))
    bus.settle()
    assert member(bus, "add").late == 1
    assert str(bus.algorithm.scene) == "ACounter#a<n=2>() · ACounter#b<n=2>()"


def test_a_second_answer_to_a_tick_is_dropped_and_counted():
    bus = started().do("hold up host, frame")
    bus.put(m.TickReply("add", 1, (eAdd(50),)))
    bus.do("settle, release, settle").expect("""
        > begin 1
        > add: ticked 1: eAdd<n=1>
            ~hosts ← evolve 1 on host: eAdd<n=1>
        > add: ticked 1: eAdd<n=50>
        > host: evolved 1: #a #b
            frame 1 is done: eAdd<n=1>; #a: ACounter#a<n=2>(), #b: ACounter#b<n=2>()
    """)
    assert member(bus, "add").late == 1


def test_an_unrequested_reply_is_dropped_and_counted():
    bus = started(members={"screen": service("screen", Screen)}).do("hold down add, step begin")
    for name in ("screen", "nobody", "host"):
        bus.put(m.TickReply(name, 1, (eAdd(50),)))
        bus.put(m.EvolveReply(name, 1, 0, {"a": VOCABULARY.read("ACounter#a<n=66>")}))
    bus.do("settle, release, settle")
    assert [member(bus, name).late for name in ("screen", "host")] == [2, 2]
    assert bus.algorithm.members.strangers == 2
    assert str(bus.algorithm.scene) == "ACounter#a<n=2>() · ACounter#b<n=2>()"


@pytest.mark.parametrize(("frame", "part"), [(0, 0), (2, 0), (1, 1), (1, 7)])
def test_an_answer_of_a_host_for_another_frame_or_part_is_dropped_and_counted(frame, part):
    bus = started().do("hold down host, frame")
    bus.put(m.EvolveReply("host", frame, part, {"a": VOCABULARY.read("ACounter#a<n=66>")}))
    bus.do("settle, release, settle")
    assert member(bus, "host").late == 1
    assert str(bus.algorithm.scene) == "ACounter#a<n=2>() · ACounter#b<n=2>()"


def test_a_dead_hosts_reply_is_dropped_after_another_was_asked():
    bus = started(members={"other": host("other", Counter)})
    bus.do("hold up host, frame, vanish host, settle, release, settle").expect("""
        > begin 1
        > add: ticked 1: eAdd<n=1>
            ~hosts ← evolve 1 on host, other: eAdd<n=1>
        > other: evolved 1: #b
        > host vanished
            says host: is gone; other hosts take its agents over
            other ← fragments #a
            other ← evolve 1 on other (#a only): eAdd<n=1>
        > other: evolved 1: #a
            frame 1 is done: eAdd<n=1>; #a: ACounter#a<n=2>(), #b: ACounter#b<n=2>()
        > host: evolved 1: #a
    """)
    assert member(bus, "host").late == 1


def test_a_late_member_is_one_until_it_answers():
    bus = started().do("hold up add, frame")
    bus.handle(s.Silent())
    assert member(bus, "add").state is MemberState.LATE
    bus.do("release, settle")
    assert member(bus, "add").state is MemberState.PRESENT
    bus.do("hold up host, frame")
    bus.handle(s.Silent())
    assert member(bus, "host").state is MemberState.LATE
    bus.do("release, settle")
    assert member(bus, "host").state is MemberState.PRESENT


HIS = VOCABULARY.read("ACounter#b<n=66>")
STRANGE = {
    "changes": m.EvolveReply("other", 1, 0, {"b": HIS}),
    "deletes": m.EvolveReply("other", 1, 0, {"b": VOCABULARY.read("")}),
    "shows": m.EvolveReply("other", 1, 0, views={"eShow": {"b": VOCABULARY.read("PDot<x=1>")}}),
    "invents": m.EvolveReply("other", 1, 0, {"z": VOCABULARY.read("ACounter#z")}),
    "speaks for": m.EvolveReply("other", 1, 0, emitted={"b": (eDone(sender="b"),)}),
    "speaks as": m.EvolveReply("other", 1, 0, emitted={"a": (eDone(sender="b"),)}),
}


@pytest.mark.parametrize("how", STRANGE)
def test_a_host_that_answers_for_agents_of_another_is_shut_out(how):
    """`other` has #a, `host` has #b; foreign fragments are rejected, and #a moves to `host`."""
    bus = started(members={"other": host("other", Counter)}, expected=["add", "host"])
    held = list(bus.alive["other"].host.fragments)
    swap = {"other": "host", "host": "other"} if held == ["b"] else {}
    answer = STRANGE[how]
    bus.do("hold down host, hold down other, frame")
    name = swap.get("other", "other")
    bus.put(m.EvolveReply(name, 1, 0, answer.changed, answer.emitted, answer.views))
    bus.step(("up", name))
    bus.do("release, settle")
    assert name not in bus.alive
    assert any(said.startswith(f"{name}: broke the protocol: ") for said in bus.said)
    if name in bus.algorithm.world.expected:
        bus.appear(name)
    bus.settle()
    assert str(bus.algorithm.scene) == "ACounter#a<n=2>() · ACounter#b<n=2>()"
    assert not bus.algorithm.inbox.emitted


@pytest.mark.parametrize("name", ["a", "b"])
def test_a_patch_of_a_view_that_there_is_not_is_refused(name):
    members = {"other": host("other", Counter), "screen": service("screen", Screen)}
    bus = started(members=members, expected=["add", "screen"])
    (owner,) = [id for id, it in bus.alive.items() if [*it.host.fragments] == [name]]
    bus.hold(("down", owner))
    bus.frame()
    patch = Delta(1, ("PDot",), ())
    bus.put(m.EvolveReply(owner, 1, 0, views={"eShow": {name: patch}}))
    bus.step(("up", owner))
    bus.do("release, settle")
    said = "it sent a patch of PDot, which is not in columns, which do not match the string"
    assert f"{owner}: broke the protocol: {said}" in bus.said
    assert str(bus.algorithm.scene) == "ACounter#a<n=2>() · ACounter#b<n=2>()"


def test_the_trace_of_one_that_is_shut_out():
    bus = started(members={"other": host("other", Counter)})
    bus.do("hold down host, hold down other, frame")
    bus.put(m.EvolveReply("other", 1, 0, {"z": VOCABULARY.read("ACounter#z")}))
    bus.do("release, settle").expect("""
        > begin 1
        > add: ticked 1: eAdd<n=1>
            ~hosts ← evolve 1 on host, other: eAdd<n=1>
        > host: evolved 1: #a
        > other: evolved 1: #z
            says other: broke the protocol: it answered for #z, not its own
            other ← refused: it answered for #z, not its own
            host ← fragments #b
            host ← evolve 1 on host (#b only): eAdd<n=1>
        > host: evolved 1: #b
            frame 1 is done: eAdd<n=1>; #a: ACounter#a<n=2>(), #b: ACounter#b<n=2>()
        > other: evolved 1: #b
        > other vanished
    """)


def test_an_agent_may_not_become_two_with_an_id_of_another():
    """Only the coordinator sees the whole string; it names the sender."""
    bus = started(members={"other": host("other", Counter)})
    ids = {
        name: sorted(process.host.fragments)
        for name, process in bus.alive.items()
        if process.host.kinds
    }
    assert sorted(ids.values()) == [["a"], ["b"]]
    (thief,) = [name for name, held in ids.items() if held == ["a"]]
    bus.hold(("down", thief))
    bus.frame()
    twins = VOCABULARY.read("ACounter#a · ACounter#b<n=5>")
    bus.put(m.EvolveReply(thief, 1, 0, {"a": twins}))
    bus.step(("up", thief))
    assert bus.said == [f"{thief}: broke the protocol: it made a second agent #b"]


SECOND = {
    "a patch": lambda part: {"changed": {"~AMinnow.1": difference(part, Minnow.many([*part.ids, "a"]).pieces[0])}},
    "columns": lambda part: {"changed": {"~AMinnow.1": Minnow.many(["a", *part.ids])}},
    "rows and a node": lambda part: {"changed": {"~AMinnow.1": Minnow.many(part.ids) + VOCABULARY.read("AFly#a")}},
    "a patch with the id of another part": lambda part: {
        "changed": {"~AMinnow.1": difference(part, Minnow.many([*part.ids, "n1"]).pieces[0])}
    },
}  # fmt: skip


@pytest.mark.parametrize("how", SECOND)
def test_a_host_of_columns_may_not_give_a_newborn_the_id_of_another(how):
    """The world goes on, and another host evolves its agents; nothing of the reply counts."""
    w = (
        Minnow.many([f"m{n}" for n in range(40)])
        + VOCABULARY.read("ACounter#a")
        + Minnow.many(["n0", "n1"])
    )
    members = {"steps": service("steps", Steps), "host": host("host", Counter)}
    members |= {name: host(name, Minnow) for name in ("thief", "next")}
    bus = MemoryBus(world(w, ["host", "steps"]), members)
    for name in ("host", "thief", "steps"):
        bus.appear(name)
    bus.run(1)
    part = bus.algorithm.composition.parts["~AMinnow.1"]
    bus.hold(("down", "thief"))
    bus.frame()
    bus.put(m.EvolveReply("thief", 1, 0, **SECOND[how](part)))
    bus.step(("up", "thief"))
    bus.release()
    bus.appear("next")
    bus.run(3)
    second = "n1" if "another part" in how else "a"
    assert f"thief: broke the protocol: it made a second agent #{second}" in bus.said
    assert bus.algorithm.placement.occupied == ["host", "next"]
    assert len(bus.records) == 5


def test_undeclared_events_of_a_generator_are_rejected():
    bus = started()
    bus.step(BEGIN)
    bus.put(m.TickReply("add", 1, (eCroak(1.0),)))
    bus.do("step up add, settle").expect("""
        > begin 1
        > add: ticked 1: eCroak<x=1>
            says add: broke the protocol: it sent eCroak, but its hello declares eAdd
            add ← refused: it sent eCroak, but its hello declares eAdd
        > add: ticked 1: eAdd<n=1>
        > add vanished
    """)
    bus.do("appear add, settle")
    assert str(bus.algorithm.scene) == "ACounter#a<n=2>() · ACounter#b<n=2>()"


class Free(Generator, events=("eAdd",), when="freely"):
    pass


def test_events_of_a_free_generator_count_in_the_next_frame():
    bus = started(members={"free": service("free", Free)})
    bus.put(bus.alive["free"].emitted(eAdd(10)))
    bus.put(bus.alive["free"].emitted(eAdd(20)))
    bus.do("settle, hold up add, frame")
    bus.put(bus.alive["free"].emitted(eAdd(30)))
    bus.do("settle, release, settle").expect("""
        > free: emitted eAdd<n=10>
        > free: emitted eAdd<n=20>
        > begin 1
        > free: emitted eAdd<n=30>
        > add: ticked 1: eAdd<n=1>
            ~hosts ← evolve 1 on host: eAdd<n=1>, eAdd<n=10>, eAdd<n=20>, eAdd<n=30>
        > host: evolved 1: #a #b
            frame 1 is done: eAdd<n=1>, eAdd<n=10>, eAdd<n=20>, eAdd<n=30>; #a: ACounter#a<n=62>(), #b: ACounter#b<n=62>()
    """)


def test_a_free_generator_with_a_forbidden_event_is_removed():
    bus = started(members={"free": service("free", Free)})
    bus.put(m.Emitted("free", (eCroak(1.0),)))
    bus.settle()
    assert "free" not in bus.alive
    assert "broke the protocol: it sent eCroak" in bus.said[0]


def test_only_joined_members_emit():
    bus = started()
    bus.put(m.Emitted("stranger", (eAdd(50),)))
    bus.run(1)
    assert str(bus.algorithm.scene) == "ACounter#a<n=2>() · ACounter#b<n=2>()"


def test_one_that_answers_in_lockstep_and_emits_besides_loses_nothing():
    bus = started()
    bus.put(m.Emitted("add", (eAdd(10),)))
    bus.run(1)
    assert str(bus.algorithm.scene) == "ACounter#a<n=12>() · ACounter#b<n=12>()"


def test_a_member_that_fails_is_named_with_its_frame_and_the_world_waits_for_the_next():
    class Broken(Frog, symbol="ACounter"):
        pass

    bus = started()
    bus.put(m.Failed("add", 1, "ZeroDivisionError: division by zero", "Traceback ..."))
    bus.do("vanish add, run 1")
    assert bus.said[0].startswith("add: failed in frame 1: ZeroDivisionError: division by zero")
    assert bus.algorithm.waiting_for() == ["add"]


def test_garbage_from_a_member_is_named_and_the_member_is_shut_out():
    bus = started()
    bus.handle(s.Violation("add", "this is not msgpack"))
    bus.settle()
    assert "add" not in bus.alive
    assert bus.said == ["add: broke the protocol: this is not msgpack"]
    bus.do("appear add, run 1")
    assert len(bus.records) == 2


def test_a_repeated_sender_of_garbage_is_named_once_until_it_rejoins():
    bus = started()
    for round_ in (1, 2):
        for number in range(20):
            bus.handle(s.Violation("add", f"garbage {number}"))
        bus.settle()
        assert bus.said == ["add: broke the protocol: garbage 0"] * round_
        bus.do("appear add, run 1")
    bus.handle(s.Appeared("odd"))
    for _ in range(20):
        bus.handle(m.Hello("odd", 0))
    assert [said for said in bus.said if said.startswith("odd: may not join")] == bus.said[2:]
    assert len(bus.said) == 3


def test_garbage_in_the_name_of_a_stranger_changes_nothing():
    bus = started()
    bus.handle(s.Violation("stranger", "this is not msgpack"))
    bus.run(1)
    assert len(bus.records) == 2


def test_a_reply_precedes_the_events_that_its_member_had_sent_before():
    bus = started()
    bus.handle(m.Emitted("add", (eAdd(5),)))
    assert member(bus, "add").last_reply == 1
    bus.run(2)
    assert [event.n for event in bus.records[1].events] == [1, 5]
    assert member(bus, "add").last_reply == 2
