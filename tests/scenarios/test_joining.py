"""Members that join: before the start, late, while the world runs, twice, or incorrectly."""

from dataclasses import replace

import pytest
from pond import (
    VOCABULARY,
    Add,
    Counter,
    Frog,
    Mother,
    Screen,
    Steps,
    counters,
    host,
    service,
    started,
)

from minerva_bus import Agent, Device, Generator, Vocabulary
from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.member_side import Member
from minerva_bus.frame.member_table import MemberState
from minerva_bus.world.services import Participation, When


def test_all_are_there_before_the_first_frame():
    bus = counters(frames=1)
    bus.do("start, run").expect("""
        > add joins at frame 0: generator
        > host joins at frame 0: agents
            ready for frame 0
        > begin 0
        > add: ticked 0: eAdd<n=1>
            host ← fragments #a #b
            ~hosts ← evolve 0 on host: eAdd<n=1>
        > host: evolved 0: #a #b
            frame 0 done: eAdd<n=1>; #a: ACounter#a<n=1>(), #b: ACounter#b<n=1>()
            stopping
            ~all ← stop: the frames are over
        > add: report {'adders': 1, 'added': 1}
        > host: report
            ended: the frames are over {'adders': 1, 'added': 1}
        > add vanished
        > host vanished
    """)


def test_the_first_frame_waits_for_all_members_of_the_world_file():
    bus = counters().do("appear add, settle")
    assert bus.algorithm.waiting_for() == ["host"]
    bus.expect("""
        > add joins at frame 0: generator
    """)
    bus.do("appear host, settle").expect("""
        > host joins at frame 0: agents
            ready for frame 0
    """)


def test_a_host_that_joins_takes_over_agents_and_changes_nothing():
    plain, bus = counters(), counters()
    plain.do("start, run 4")
    bus.do("start, run 2, clear")
    bus.join("heir", host("heir", Counter))
    bus.do("run 2").expect("""
        > heir joins at frame 2: agents
        > begin 2
        > add: ticked 2: eAdd<n=1>
            heir ← fragments #b
            host ← fragments nothing, without #b
            ~hosts ← evolve 2 on heir, host: eAdd<n=1>
        > heir: evolved 2: #b
        > host: evolved 2: #a
            frame 2 is done: eAdd<n=1>; #a: ACounter#a<n=3>(), #b: ACounter#b<n=3>()
        > begin 3
        > add: ticked 3: eAdd<n=1>
            ~hosts ← evolve 3 on heir, host: eAdd<n=1>
        > heir: evolved 3: #b
        > host: evolved 3: #a
            frame 3 is done: eAdd<n=1>; #a: ACounter#a<n=4>(), #b: ACounter#b<n=4>()
    """)
    assert bus.digests == plain.digests


def test_a_member_that_joins_in_the_midst_of_a_frame_is_admitted_at_its_edge():
    bus = started()
    bus.do("clear, hold up host, frame")
    bus.join("heir", host("heir", Counter))
    bus.settle()
    assert bus.algorithm.members.get("heir").state is MemberState.JOINING
    bus.do("release, settle, frame").expect("""
        > begin 1
        > add: ticked 1: eAdd<n=1>
            ~hosts ← evolve 1 on host: eAdd<n=1>
        > heir appeared
            heir ← greet
        > heir: hello, agents
        > host: evolved 1: #a #b
            frame 1 is done: eAdd<n=1>; #a: ACounter#a<n=2>(), #b: ACounter#b<n=2>()
        > begin
            heir ← welcome to frame 2
            ~tick ← tick 2
        > add: ticked 2: eAdd<n=1>
            heir ← fragments #b
            host ← fragments nothing, without #b
            ~hosts ← evolve 2 on heir, host: eAdd<n=1>
        > heir: evolved 2: #b
        > host: evolved 2: #a
            frame 2 is done: eAdd<n=1>; #a: ACounter#a<n=3>(), #b: ACounter#b<n=3>()
    """)


def test_a_host_that_joins_while_generators_answer_evolves_in_this_frame():
    bus = counters().do("start, settle, hold up add, frame")
    bus.join("heir", host("heir", Counter))
    bus.do("settle, release, settle")
    assert any(line.strip().startswith("~hosts ← evolve 0 on heir, host") for line in bus.trace)


def test_an_observer_that_joins_gets_the_last_view_whole():
    bus = started(members={"screen": service("screen", Screen)}, after=2)
    bus.trace.clear()
    bus.join("look", service("look", lambda: Screen(0)))
    bus.do("settle").expect("""
        > look joins at frame 2: device
            look ← view 1 of eShow, number 2: all of #a #b
    """)
    bus.frame()
    assert bus.alive["look"].service.shown == bus.alive["screen"].service.shown[-2:]


def test_a_generator_that_joins_is_asked_from_the_next_frame_on():
    bus = started("ACounter#a")
    bus.join("more", service("more", lambda: Add(10)))
    bus.do("clear, run 1").expect("""
        > more joins at frame 1: generator
        > begin 1
        > add: ticked 1: eAdd<n=1>
        > more: ticked 1: eAdd<n=10>
            ~hosts ← evolve 1 on host: eAdd<n=1>, eAdd<n=10>
        > host: evolved 1: #a
            frame 1 is done: eAdd<n=1>, eAdd<n=10>; #a: ACounter#a<n=12>()
    """)


def test_a_successor_with_the_same_name_and_other_faces_is_taken_for_what_it_is():
    """A member leaves in the middle of a frame, and another one of its name joins as a host."""
    bus = counters()
    bus.start()
    bus.join("heir", service("heir", Screen))
    bus.do("run 1, leave heir")
    bus.join("heir", host("heir", Counter))
    bus.do("step up heir, hold up heir, settle, frame, release, run 2")
    assert bus.stuck == []
    assert bus.algorithm.members.get("heir").hello.roles == ("agents",)
    assert len(bus.alive["heir"].host.fragments) + len(bus.alive["host"].host.fragments) == 2


class Elsewhere(Agent, symbol="ACounter"):
    n: int = 0
    m: float = 0.0


class Rain(Generator, events=("eRain",)):
    pass


class Canvas(Device, draws=("eCanvas",)):
    pass


@pytest.mark.parametrize(
    ("stranger", "reason"),
    [
        (service("new", Canvas), "has no event type eCanvas; its visual ones: e"),
        (service("new", Rain), "the world's vocabulary has no event type eRain"),
        (host("new", type("Toad", (Frog,), {}, symbol="AToad")), "no agents AToad"),
        (host("new", Elsewhere), "its ACounter has the state (n, m), the world's (n): both must"),
    ],
)
def test_a_stranger_is_refused_with_a_reason_and_the_world_goes_on(stranger, reason):
    bus = started(members={})
    bus.join("new", stranger)
    bus.run(1)
    assert "new" not in bus.alive
    assert any(f"new: may not join: {reason}" in said or reason in said for said in bus.said)
    assert len(bus.records) == 2


def test_a_member_of_another_protocol_is_refused():
    bus = started()
    bus.handle(s.Appeared("old"))
    bus.put(m.Hello("old", 0, generates=("eAdd",)))
    bus.do("run 1").expect("""
        > old appeared
            old ← greet
        > old: hello, generator
            says old: may not join: it speaks protocol 0, this world 7: install the same version of Minerva Bus on both sides
            old ← refused: it speaks protocol 0, this world 7: install the same version of Minerva Bus on both sides
        > frame 1 as usual: #a: ACounter#a<n=2>(), #b: ACounter#b<n=2>()
    """)


def test_a_world_ends_when_one_that_it_needs_is_refused():
    bus = started(members={"rain": service("rain", Rain)}, after=0)
    assert bus.ended.reason.startswith("rain cannot take part: the world's vocabulary has no")
    assert bus.algorithm.failed


def test_a_hello_out_of_turn_is_ignored():
    bus = started()
    hello = bus.alive["add"].hello()
    bus.put(replace(hello, generates=("eStep",), when=When(Participation.FREELY)))
    bus.put(replace(hello, member="nobody"))
    bus.do("clear, run 1").expect("""
        > add: hello, generator
        > nobody: hello, generator
            says nobody: unknown member: message ignored
        > frame 1 as usual: #a: ACounter#a<n=2>(), #b: ACounter#b<n=2>()
    """)


def test_a_member_that_appears_during_shutdown_is_notified():
    bus = started(after=0)
    bus.handle(s.End("enough"))
    bus.join("late", host("late", Mother))
    bus.settle()
    assert bus.ended.reason == "enough"
    assert "late" not in bus.alive


def test_the_welcome_has_all_that_a_member_needs():
    bus = started(seed=3, dt=0.5, name="garden", after=2)
    bus.join("new", service("new", Steps))
    bus.run(1)
    welcome = bus.alive["new"].world
    assert (welcome.world, welcome.seed, welcome.dt, welcome.frame) == ("garden", 3, 0.5, 2)
    assert isinstance(welcome.vocabulary, Vocabulary)
    assert welcome.vocabulary is VOCABULARY
    assert isinstance(bus.alive["new"], Member)
