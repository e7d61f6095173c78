"""Ends of a world: by its rules, by an operator, in any phase; reports of members."""

import pytest
from pond import (
    Add,
    Counter,
    Mother,
    Screen,
    counters,
    eCroak,
    eDone,
    finished,
    host,
    service,
    started,
)

from minerva_bus import EMPTY, on
from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import Phase


@pytest.mark.parametrize("frames", [1, 2, 9])
def test_after_so_many_frames(frames):
    bus = finished(frames=frames)
    assert bus.ended.reason == "the frames are over"
    assert len(bus.records) == bus.algorithm.frame == frames


def test_when_every_agent_has_sent_an_event():
    """Counters send eDone when they reach 7."""
    bus = finished("ACounter#a<n=5> · ACounter#b<n=3>", until="eDone")
    assert bus.ended.reason == "every agent has sent eDone"
    assert bus.algorithm.reached
    assert bus.algorithm.frame == 4


def test_agents_of_kinds_that_do_not_send_it_are_not_asked():
    bus = finished("ACounter#a<n=5> · AMother#m", until="eDone")
    assert bus.algorithm.frame == 2


def test_it_is_not_reached_while_one_of_the_kind_has_not_sent_it():
    bus = started("ACounter#a<n=5> · ACounter#b<n=7>", until="eDone", after=10)
    assert bus.ended is None
    assert not bus.algorithm.reached


class Quitter(Counter, symbol="ACounter"):
    """Gives up at 4, but still reports eDone at 7."""

    @on("eAdd")
    def add(self, add, moment):
        self.n += add.n
        if self.n in (4, 7):
            moment.emit(eDone() if self.n == 7 else eCroak(0.5))


QUITTERS = {"give_up": "eCroak", "members": {"host": host("host", Quitter)}}


def test_agents_that_give_up_end_a_world_with_their_reasons():
    bus = finished("ACounter#a<n=5> · ACounter#b<n=2>", until="eDone", **QUITTERS)
    assert bus.ended.reason == "#b has given up: eCroak<x=0.5>"
    assert not bus.algorithm.reached
    assert "b: gave up: eCroak<x=0.5>" in "\n".join(bus.trace)


def test_one_that_gives_up_and_goes_on_can_still_reach_it():
    bus = started("ACounter#a<n=2> · ACounter#b<n=-4>", after=3, until="eDone", **QUITTERS)
    state = bus.algorithm.checkpoint
    assert bus.ended is None
    bus.run()
    assert bus.ended.reason == "#b has given up: eCroak<x=0.5>"
    again = counters(str(bus.algorithm.scene), until="eDone", past=state, **QUITTERS)
    assert again.algorithm.goal.finished == ""


def test_giving_up_ends_nothing_without_until():
    bus = started("ACounter#a<n=2>", after=9, **QUITTERS)
    assert bus.ended is None


class Mayfly(Counter, symbol="ACounter"):
    """Reports eDone and dies in the same step."""

    @on("eAdd")
    def add(self, add, moment):
        self.n += add.n
        if self.n == 7:
            moment.emit(eDone())
            return EMPTY
        return None


def test_one_that_sends_it_and_dies_does_not_speak_for_the_others():
    bus = finished(
        "ACounter#a<n=5> · ACounter#b<n=3>", until="eDone", members={"host": host("host", Mayfly)}
    )
    assert bus.algorithm.frame == 4


@pytest.mark.parametrize("phase", list(Phase))
def test_a_person_may_end_it_in_any_phase(phase):
    bus = counters(frames=2, members={"screen": service("screen", Screen)})
    for name in sorted(bus.makers):
        if phase is not Phase.WAITING or name != "host":
            bus.appear(name)
    steps = {
        Phase.TICK: "hold up add, frame",
        Phase.EVOLVE: "hold up host, frame",
        Phase.CLOSING: "frame, hold down host, frame, step down host, step up host",
        Phase.STOPPING: "frame, hold down screen, frame",
        Phase.ENDED: "frame, hold down screen, frame, release, settle",
    }
    bus.do(f"settle, {steps.get(phase, 'settle')}")
    assert bus.algorithm.phase is phase
    bus.handle(s.End("a person wishes it"))
    bus.do("release, settle")
    over = phase in (Phase.STOPPING, Phase.ENDED)
    assert bus.ended.reason == ("the frames are over" if over else "a person wishes it")


@pytest.mark.parametrize("awaited", ["add", "host"])
def test_an_interrupted_frame_awaits_nothing(awaited):
    bus = counters().do(f"start, settle, hold up {awaited}, frame")
    assert bus.algorithm.awaits(awaited)
    bus.handle(s.End("enough"))
    bus.handle(m.Report(awaited, {"x": 1}))
    assert not bus.algorithm.awaits(awaited)
    bus.handle(s.Skip(awaited))
    assert bus.said == []


def test_one_that_was_greeted_before_the_end_does_not_join_after_it():
    """Although agents of the interrupted frame wait for a host."""
    bus = counters().do("start, settle, hold up host, hold up heir, frame, vanish host")
    bus.join("heir", host("heir", Counter))
    bus.settle()
    bus.handle(s.End("enough"))
    bus.do("clear, release, settle")
    assert not any("heir ← welcome" in line for line in bus.trace), bus


def test_messages_after_the_end_are_ignored():
    bus = counters(frames=1).do("start, run, clear")
    for stimulus in (
        s.Begin(),
        s.End("again"),
        s.Silent(),
        m.TickReply("add", 0),
        m.EvolveReply("host", 0),
        m.Report("add", {"added": 5}),
        m.Emitted("add", ()),
        s.Violation("add", "late"),
        s.Abandoned("add"),
        s.Vanished("host"),
    ):
        bus.handle(stimulus)
    assert bus.ended.figures == {"adders": 1, "added": 1}
    assert not any("ended" in line for line in bus.trace)


def test_figures_of_one_name_are_added_and_others_stand_side_by_side():
    members = {
        "add": service("add", lambda: Add(3)),
        "more": service("more", lambda: Add(10)),
        "screen": service("screen", Screen),
    }
    bus = finished(frames=2, members=members)
    assert bus.ended.figures == {"adders": 2, "added": 13, "pictures": 3}


def test_figures_of_guests_count_and_those_of_the_dead_do_not():
    bus = counters(members={"more": service("more", lambda: Add(10))})
    bus.start()
    bus.join("guest", service("guest", lambda: Add(30)))
    bus.do("run 1, vanish more")
    bus.handle(s.End("enough"))
    bus.settle()
    assert bus.ended.figures == {"adders": 2, "added": 31}


def test_a_report_counts_once_and_from_members_only():
    bus = started(frames=1, after=0).do("hold up add, hold up host, frame, release")
    bus.put(m.Report("stranger", {"added": 5}))
    bus.settle()
    bus.put(m.Report("add", {"added": 5}))
    bus.settle()
    assert bus.ended.figures == {"adders": 1, "added": 1}


def test_one_that_dies_with_its_report_unsaid_does_not_hold_the_end_up():
    bus = started(frames=1, after=0)
    bus.do("hold down host, frame, step down host, step down host")
    bus.do("settle, vanish host, clear, settle").expect("""
        > host vanished
        > silent
        > silent
            ended: the frames are over {'adders': 1, 'added': 1}
    """)


def test_a_silent_member_is_not_awaited_for_ever():
    """The time-out is detected outside the algorithm, which receives `End`."""
    bus = started(frames=1, after=0).do("hold up host, step begin, settle, step up host, settle")
    assert bus.algorithm.phase is Phase.STOPPING
    assert bus.algorithm.waiting_for() == ["host"]
    bus.handle(s.End("no report in time"))
    assert bus.ended.reason == "the frames are over"


def test_a_world_without_agents_ends_at_once():
    bus = counters(members={"add": service("add", Add)}, expected=[])
    bus.handle(s.End("never mind"))
    assert bus.ended.reason == "never mind"
    assert bus.ended.figures == {}


def test_the_last_view_waits_for_a_host_that_is_away_unless_it_is_given_up():
    bus = started(frames=1, members={"screen": service("screen", Screen)}, after=0)
    bus.do("hold down host, frame, step down host, step down host")
    bus.do("step up host, vanish host, settle")
    assert bus.algorithm.phase is Phase.CLOSING
    assert bus.algorithm.waiting_for() == ["host"]
    bus.do("clear, abandon host, settle").expect("""
        > host is given up
            says host: is not restarted; the world continues without it
            screen ← view 1 of eShow, number 2: all of #a #b
            stopping
            ~all ← stop: the frames are over
        > add: report {'adders': 1, 'added': 1}
        > screen: report {'pictures': 2}
            ended: the frames are over {'adders': 1, 'added': 1, 'pictures': 2}
        > add vanished
        > screen vanished
    """)


def test_mothers_and_counters_end_the_same_way_however_often():
    def run():
        bus = counters(
            "AMother#m · ACounter#c", members={"host": host("host", Counter, Mother)}, frames=5
        )
        bus.do("start, run")
        return bus.digests, bus.trace

    assert run() == run()
