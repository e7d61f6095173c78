"""Members that leave: in a tick, in evolution, between frames; awaited or given up."""

import pytest
from pond import (
    Add,
    Bus,
    Counter,
    Eye,
    Fly,
    Mother,
    Steps,
    Water,
    counters,
    host,
    service,
    started,
    undisturbed,
    world,
)

from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.member_table import MemberState


def test_the_world_waits_for_a_generator_that_dies_in_a_tick():
    bus = started().do("step begin, vanish add, settle")
    assert bus.algorithm.waiting_for() == ["add"]
    bus.do("appear add, settle").expect("""
        > begin 1
        > add vanished
            says add: is gone; the world waits for it
        > add joins at frame 1: generator
            add ← tick 1
        > add: ticked 1: eAdd<n=1>
            ~hosts ← evolve 1 on host: eAdd<n=1>
        > host: evolved 1: #a #b
            frame 1 is done: eAdd<n=1>; #a: ACounter#a<n=2>(), #b: ACounter#b<n=2>()
    """)
    assert bus.digests == undisturbed(2)


def test_the_world_waits_for_a_generator_that_died_between_frames():
    bus = started().do("vanish add, run 1")
    assert bus.algorithm.waiting_for() == ["add"]
    bus.do("appear add, settle").expect("""
        > add vanished
            says add: is gone; the world waits for it
        > begin
        > add joins at frame 1: generator
            add ← tick 1
        > add: ticked 1: eAdd<n=1>
            ~hosts ← evolve 1 on host: eAdd<n=1>
        > host: evolved 1: #a #b
            frame 1 is done: eAdd<n=1>; #a: ACounter#a<n=2>(), #b: ACounter#b<n=2>()
    """)
    assert bus.digests == undisturbed(2)


def test_a_dead_generators_reply_is_requested_again_during_the_tick():
    """Its successor must know what it had published; here it had published nothing."""
    bus = started(members={"slow": service("slow", Steps)})
    bus.do("hold up slow, frame, restart add, settle, release, settle").expect("""
        > begin 1
        > add: ticked 1: eAdd<n=1>
        > add vanished
            says add: is gone; the world waits for it
        > add joins at frame 1: generator
            add ← tick 1
        > add: ticked 1: eAdd<n=1>
        > slow: ticked 1: eStep<count=2>
            ~hosts ← evolve 1 on host: eAdd<n=1>, eStep<count=2>
        > host: evolved 1: #a #b
            frame 1 is done: eAdd<n=1>, eStep<count=2>; #a: ACounter#a<n=2>(), #b: ACounter#b<n=2>()
    """)


def test_a_successor_goes_on_from_what_was_saved_in_the_last_whole_frame():
    members = {"steps": service("steps", Steps)}
    plain, bus = (Bus(world("ACounter#a", members), members) for _ in range(2))
    plain.do("start, run 6")
    bus.start()
    for _ in range(6):
        bus.do("run 1, restart steps")
    assert [record.events for record in bus.records] == [record.events for record in plain.records]


class Forgetful(Add):
    """Saves something in its first frame only."""

    frame = 0

    def generate(self, tick):
        self.frame = tick.number
        return super().generate(tick)

    def save(self):
        return None if self.frame else {"n": 5}

    def restore(self, saved):
        self.n = saved["n"]


def test_a_successor_of_one_that_saves_nothing_any_more_gets_nothing():
    bus = counters(members={"add": service("add", Forgetful)})
    bus.do("start, run 2, restart add, run 1")
    assert [event.n for record in bus.records for event in record.events] == [1, 1, 1]


def test_a_host_that_is_skipped_keeps_its_agents_as_they_were():
    """Whatever it has made of them by then: it gets them again."""
    bus = counters("ACounter#a").do("start, settle, hold up host, frame")
    bus.handle(s.Skip("host"))
    assert str(bus.algorithm.scene) == "ACounter#a<n=0>()"
    assert bus.inputs[0].left_out == ("a",)
    bus.do("release, run 1")
    assert str(bus.algorithm.scene) == "ACounter#a<n=1>()"


@pytest.mark.parametrize("gone", ["add", "host"])
def test_a_frame_does_not_wait_for_a_lost_member_that_is_skipped(gone):
    bus = counters("ACounter#a")
    bus.do(f"start, settle, hold up {gone}, frame, vanish {gone}, settle")
    assert bus.algorithm.waiting_for() == [gone]
    bus.handle(s.Skip(gone))
    bus.settle()
    assert str(bus.algorithm.scene) == "ACounter#a<n=0>()"
    assert len(bus.records) == 1


def test_the_world_waits_for_a_host_that_dies_in_evolution():
    bus = started().do("hold down host, frame, vanish host, settle, release, settle")
    assert bus.algorithm.waiting_for() == ["host"]
    bus.do("appear host, settle").expect("""
        > begin 1
        > add: ticked 1: eAdd<n=1>
            ~hosts ← evolve 1 on host: eAdd<n=1>
        > host vanished
            says host: is gone; the world waits for it
        > host joins at frame 1: agents
            host ← fragments #a #b
            host ← evolve 1 on host (#a #b only): eAdd<n=1>
        > host: evolved 1: #a #b
            frame 1 is done: eAdd<n=1>; #a: ACounter#a<n=2>(), #b: ACounter#b<n=2>()
    """)
    assert bus.digests == undisturbed(2)


def test_another_host_takes_over_what_one_that_died_in_evolution_leaves():
    members = {"host": host("host", Counter), "other": host("other", Counter)}
    bus = started(members=members)
    bus.do("hold down host, frame, vanish host, settle, release, settle, frame").expect("""
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
        > begin 2
        > add: ticked 2: eAdd<n=1>
            ~hosts ← evolve 2 on other: eAdd<n=1>
        > other: evolved 2: #a #b
            frame 2 is done: eAdd<n=1>; #a: ACounter#a<n=3>(), #b: ACounter#b<n=3>()
    """)
    assert bus.digests == undisturbed(3)


def test_a_dead_hosts_reply_counts_and_goes_to_its_successor():
    members = {"host": host("host", Counter), "other": host("other", Counter)}
    bus = started(members=members)
    bus.do("hold down other, frame, vanish host, settle, release, settle, frame").expect("""
        > begin 1
        > add: ticked 1: eAdd<n=1>
            ~hosts ← evolve 1 on host, other: eAdd<n=1>
        > host: evolved 1: #a
        > host vanished
            says host: is gone; other hosts take its agents over
        > other: evolved 1: #b
            frame 1 is done: eAdd<n=1>; #a: ACounter#a<n=2>(), #b: ACounter#b<n=2>()
        > begin 2
        > add: ticked 2: eAdd<n=1>
            other ← fragments #a
            ~hosts ← evolve 2 on other: eAdd<n=1>
        > other: evolved 2: #a #b
            frame 2 is done: eAdd<n=1>; #a: ACounter#a<n=3>(), #b: ACounter#b<n=3>()
    """)
    assert bus.digests == undisturbed(3)


def test_the_first_of_two_hosts_that_is_back_is_given_what_the_other_had_answered():
    """Both were lost in a frame, and one of them is still absent when the next frame begins."""
    members = {"host": host("host", Counter), "other": host("other", Counter)}
    bus = started(members=members)
    bus.do("hold down other, frame, vanish host, vanish other, release, settle")
    assert bus.algorithm.waiting_for() == ["host", "other"]
    bus.do("appear other, settle, frame, frame")
    assert bus.digests == undisturbed(4)


def test_a_host_that_returns_in_the_frame_of_its_reply_has_no_fragments():
    """Only `host` has mothers, so the frame waits for it; it shares the counters with `other`."""
    members = {"host": host("host", Counter, Mother), "other": host("other", Counter)}
    text = "ACounter#a · ACounter#b · ACounter#c · ACounter#d · AMother#m"
    bus = started(text, members=members)
    bus.do("hold down host, frame, restart host, settle, release, run 3")
    assert bus.stuck == []
    assert bus.digests == undisturbed(5, text=text, members={"host": host("host", Counter, Mother)})


def test_agents_that_move_to_another_host_while_the_old_one_answers_move_with_what_it_answered():
    """Only `host` has flies, so the frame waits for it; on its return, counters move to it."""
    members = {"host": host("host", Counter, Fly), "other": host("other", Counter)}
    text = "ACounter#a · ACounter#b · ACounter#c · ACounter#d · AFly#y"
    bus = started(text, members=members)
    bus.do("vanish host, hold up other, frame, appear host, settle, release, run 3")
    assert bus.stuck == []
    assert bus.digests == undisturbed(5, text=text)


def test_agents_without_a_host_stand_still_and_the_others_evolve():
    bus = started("ACounter#a · AMother#m", after=2)
    assert str(bus.algorithm.scene) == "ACounter#a<n=2>() · AMother#m<births=0>()"


def test_agents_of_a_host_that_is_given_up_stand_still():
    bus = started("ACounter#a · AMother#m", members={"mothers": host("mothers", Mother)})
    bus.do("vanish mothers, clear, run 1, abandon mothers, run 1").expect("""
        > mothers vanished
            says mothers: is gone; the world waits for it
        > begin 1
        > add: ticked 1: eAdd<n=1>
            host ← fragments #m:1
            ~hosts ← evolve 1 on host: eAdd<n=1>
        > host: evolved 1: #a #m:1
        > mothers is given up
            says mothers: is not restarted; the world continues without it
            frame 1 is done: eAdd<n=1>; #a: ACounter#a<n=2>(), #m:1: ACounter#m:1<n=2>()
        > frame 2 as usual: #a: ACounter#a<n=3>(), #m:1: ACounter#m:1<n=3>()
    """)
    bus.do("appear mothers, run 1")
    assert "#m<births=2>" in str(bus.algorithm.scene)


def test_a_generator_given_up_in_a_tick_is_no_longer_awaited():
    bus = started(members={"more": service("more", lambda: Add(10))})
    bus.do("vanish more, run 1, clear, abandon more, run 1").expect("""
        > more is given up
            says more: is not restarted; the world continues without it
            ~hosts ← evolve 1 on host: eAdd<n=1>
        > host: evolved 1: #a #b
            frame 1 is done: eAdd<n=1>; #a: ACounter#a<n=12>(), #b: ACounter#b<n=12>()
        > frame 2 as usual: #a: ACounter#a<n=13>(), #b: ACounter#b<n=13>()
    """)


def test_a_member_given_up_before_the_start_is_not_awaited():
    bus = counters(members={"more": service("more", Add)}).do("appear add, appear host, settle")
    assert bus.algorithm.waiting_for() == ["more"]
    bus.do("abandon more, run 1")
    assert len(bus.records) == 1


def joined(bus, guest, returned):
    """Run a frame with a guest that joins, or that returns to the next coordinator."""
    if returned:
        bus.algorithm.expect(["guest"])
    bus.do("start, settle")
    assert bus.algorithm.waiting_for() == ["guest"] * returned
    bus.join("guest", guest)
    bus.run(1)


@pytest.mark.parametrize("returned", [False, True])
@pytest.mark.parametrize("how", ["vanish", "leave"])
@pytest.mark.parametrize(
    "hold", [("down", "guest"), ("up", "guest"), ("up", "slow"), ("up", "host")]
)
def test_a_guest_that_goes_is_not_waited_for(how, hold, returned):
    """The world file does not name this generator; it leaves before or after its reply."""
    bus = counters(members={"slow": service("slow", Steps)})
    joined(bus, service("guest", Add), returned)
    bus.do(f"hold {' '.join(hold)}, frame, {how} guest, settle, release, run 2")
    assert bus.stuck == []
    assert len(bus.records) == 4
    assert bus.algorithm.members.get("guest").state is MemberState.LEFT


@pytest.mark.parametrize("returned", [False, True])
@pytest.mark.parametrize("how", ["vanish", "leave"])
@pytest.mark.parametrize(
    "hold", [("down", "guest"), ("up", "guest"), ("up", "host"), ("up", "add")]
)
def test_a_guest_that_hosted_agents_gives_them_back(how, hold, returned):
    bus = counters()
    joined(bus, host("guest", Counter), returned)
    bus.do(f"hold {' '.join(hold)}, frame, {how} guest, settle, release, run 2")
    assert bus.stuck == []
    assert bus.digests == undisturbed(4)


def test_a_member_under_a_missing_guests_name_that_is_refused_does_not_end_the_world():
    bus = counters()
    bus.algorithm.expect(["guest"])
    bus.do("start, settle")
    bus.handle(s.Appeared("guest"))
    bus.put(m.Hello("guest", 0, generates=("eAdd",)))
    bus.settle()
    assert any(line.startswith("guest: may not join") for line in bus.said)
    assert bus.algorithm.waiting_for() == ["guest"]
    bus.do("abandon guest, run 2")
    assert bus.digests == undisturbed(2)


def test_one_that_leaves_of_its_own_will_is_not_waited_for():
    bus = started()
    bus.do("leave add, run 1").expect("""
        > add: leaving
            says add: has left
        > add vanished
        > begin
            frame 1 is done: no events; no change
    """)


def sights():
    return counters(
        "ACounter#a",
        members={"water": service("water", Water), "eye": service("eye", Eye)},
        frames=4,
    )


def test_readings_go_straight_from_one_to_the_other_in_the_same_frame():
    bus = sights()
    bus.do("start, run 2").expect("""
        > add joins at frame 0: generator
        > eye joins at frame 0: generator
        > host joins at frame 0: agents
        > water joins at frame 0: device
            ~all ← sources: sight by water
            ready for frame 0
        > begin 0
        > add: ticked 0: eAdd<n=1>
        > eye: ticked 0: eSeen<figures=0>
        > water: ticked 0: no events
            host ← fragments #a
            ~hosts ← evolve 0 on host: eAdd<n=1>, eSeen<figures=0>, eShow
        > host: evolved 0: #a
            water ← view 0 of eShow, number 1: all of #a
            frame 0 is done: eAdd<n=1>, eSeen<figures=0>, eShow; #a: ACounter#a<n=1>()
        > begin 1
        > add: ticked 1: eAdd<n=1>
        > eye: ticked 1: eSeen<figures=1>
        > water: ticked 1: no events
            ~hosts ← evolve 1 on host: eAdd<n=1>, eSeen<figures=1>, eShow
        > host: evolved 1: #a
            water ← view 1 of eShow, number 2: #a
            frame 1 is done: eAdd<n=1>, eSeen<figures=1>, eShow; #a: ACounter#a<n=2>()
    """)


@pytest.mark.parametrize("who", ["water", "eye"])
@pytest.mark.parametrize(
    "hold", [(way, name) for way in ("down", "up") for name in ("eye", "water")]
)
def test_readings_are_restored_after_any_death(who, hold):
    plain, bus = sights(), sights()
    plain.do("start, run")
    bus.do("start, run 1")
    for _ in range(2):
        bus.do(f"hold {' '.join(hold)}, frame, restart {who}, settle, release, settle")
    bus.run()
    assert bus.stuck == []
    assert bus.ended is not None
    assert [record.events for record in bus.records] == [record.events for record in plain.records]


def test_a_generator_does_not_wait_for_a_source_that_has_left():
    bus = sights()
    bus.do("start, run 1, vanish water, run 1, clear, abandon water, settle").expect("""
        > water is given up
            says water: is not restarted; the world continues without it
        > eye: ticked 1: no events
            ~hosts ← evolve 1 on host: eAdd<n=1>
        > host: evolved 1: #a
            frame 1 is done: eAdd<n=1>; #a: ACounter#a<n=2>()
    """)


@pytest.mark.parametrize("who", ["add", "host", "more"])
@pytest.mark.parametrize("frames", [0, 1])
def test_a_member_has_left_even_if_its_token_vanishes_first(who, frames):
    """Messages of a member and its token reach the coordinator on separate paths."""
    members = {"more": host("more", Counter)}
    plain, overtaken = counters(members=members), counters(members=members)
    for bus in (plain, overtaken):
        bus.do(f"start, run {frames}, hold up {who}")
        if bus is overtaken:
            bus.do(f"leave {who}, settle")
            assert bus.algorithm.members.get(who).state is MemberState.LOST
        bus.release()
        if bus is plain:
            bus.put(m.Leaving(who))
            bus.settle()
            bus.vanish(who)
        bus.run(3)
        assert bus.algorithm.members.get(who).state is MemberState.LEFT
        assert bus.algorithm.waiting_for() == bus.stuck == []
    assert overtaken.digests == plain.digests


@pytest.mark.parametrize("who", ["add", "host"])
def test_a_world_before_its_start_does_not_wait_for_members_that_left(who):
    bus = counters().do(f"start, hold up {who}, settle, leave {who}, settle, release, run 2")
    assert bus.algorithm.members.get(who).state is MemberState.LEFT
    assert bus.stuck == []
    assert len(bus.records) == 2
