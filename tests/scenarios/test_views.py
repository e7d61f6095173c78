"""Views: visual events, devices that request them, coupled devices, late observers."""

from dataclasses import replace

import numpy as np
import pytest
from pond import (
    Bus,
    Counter,
    Mother,
    PDot,
    Screen,
    Steps,
    TAt,
    Water,
    counters,
    eShow,
    eStep,
    host,
    service,
    started,
)

from minerva_bus import Agent, Device, Generator, Metres, Scene, Vocabulary, on, view, visualize
from minerva_bus.frame import messages as m
from minerva_bus.frame.world_state import WorldSpec
from minerva_bus.grammar.columns import Delta


def shown(bus, name="screen"):
    return bus.alive[name].service.shown


class Show(Generator, events=("eShow",)):
    """Requests a view every other frame."""

    def generate(self, tick):
        return () if tick.number % 2 else (eShow(),)


class Looker(Screen):
    def __init__(self):
        super().__init__(every=0)


def test_a_visual_event_of_a_generator_shows_the_string_of_its_frame():
    bus = started(
        "ACounter#a",
        members={"show": service("show", Show), "look": service("look", Looker)},
        after=4,
    )
    assert shown(bus, "look") == ["0: PDot<x=0>", "2: PDot<x=2>"]


def test_a_device_is_its_own_source_every_so_many_frames():
    screens = {f"screen-{n}": service(f"screen-{n}", lambda n=n: Screen(n)) for n in (1, 2, 3)}
    bus = started("ACounter#a", members=screens, after=7, frames=8)
    views = {"screen-1": range(7), "screen-2": range(0, 7, 2), "screen-3": range(0, 7, 3)}
    for name, frames in views.items():
        assert shown(bus, name) == [f"{n}: PDot<x={n}>" for n in frames]
    members = dict(bus.alive)
    bus.do("run")
    for name in views:
        assert members[name].service.shown[-1] == "8: PDot<x=8>"


def test_visual_events_are_collected_once_and_do_not_evolve_anything():
    """Two screens and a generator request the same view: one event, by equation 6."""
    members = {
        "one": service("one", Screen),
        "two": service("two", Screen),
        "show": service("show", Show),
    }
    bus, plain = counters(members=members), counters()
    for each in (bus, plain):
        each.do("start, run 2")
    assert [str(event) for event in bus.records[0].events] == ["eAdd<n=1>", "eShow"]
    assert bus.digests == plain.digests


def test_a_delta_has_only_what_looks_different_and_a_new_skeleton_makes_it_whole():
    members = {"screen": service("screen", Screen), "host": host("host", Counter, Mother)}
    bus = started("ACounter#a<n=98> · TAt<x=1>(ACounter#b)", members=members, after=0)
    bus.do("run 4").expect("""
        > begin 0
        > add: ticked 0: eAdd<n=1>
            host ← fragments #a #b
            ~hosts ← evolve 0 on host: eAdd<n=1>, eShow
        > host: evolved 0: #a #b
            observers of eShow ← view 0 of eShow, number 1: all of #a #b
            frame 0 is done: eAdd<n=1>, eShow; #a: ACounter#a<n=99>(), #b: ACounter#b<n=1>()
        > begin 1
        > add: ticked 1: eAdd<n=1>
            ~hosts ← evolve 1 on host: eAdd<n=1>, eShow
        > host: evolved 1: #a #b
            observers of eShow ← view 1 of eShow, number 2: #a #b
            frame 1 is done: eAdd<n=1>, eShow; #a: , #b: ACounter#b<n=2>()
        > begin 2
        > add: ticked 2: eAdd<n=1>
            ~hosts ← evolve 2 on host: eAdd<n=1>, eShow
        > host: evolved 2: #b
            observers of eShow ← view 2 of eShow, number 3: all of #b
            frame 2 is done: eAdd<n=1>, eShow; #b: ACounter#b<n=3>()
        > begin 3
        > add: ticked 3: eAdd<n=1>
            ~hosts ← evolve 3 on host: eAdd<n=1>, eShow
        > host: evolved 3: #b
            observers of eShow ← view 3 of eShow, number 4: #b
            frame 3 is done: eAdd<n=1>, eShow; #b: ACounter#b<n=4>()
    """)


def test_an_agent_that_looks_as_before_is_not_shown_again():
    bus = started("ACounter#a · AMother#m", members={"screen": service("screen", Screen)}, after=2)
    bus.do("hold down screen, vanish add, abandon add, settle, run 1")
    assert shown(bus)[-1].startswith("1:")
    bus.do("release, run 1")
    assert shown(bus)[-1] == "3: PDot<x=2>"


def test_a_coupled_device_has_the_view_of_a_frame_before_it_is_asked_for_the_next():
    bus = started("ACounter#a", members={"water": service("water", Water)}, frames=3, after=0)
    bus.do("run").expect("""
        > begin 0
        > add: ticked 0: eAdd<n=1>
        > water: ticked 0: no events
            host ← fragments #a
            ~hosts ← evolve 0 on host: eAdd<n=1>, eShow
        > host: evolved 0: #a
            water ← view 0 of eShow, number 1: all of #a
            frame 0 is done: eAdd<n=1>, eShow; #a: ACounter#a<n=1>()
        > begin 1
        > add: ticked 1: eAdd<n=1>
        > water: ticked 1: no events
            ~hosts ← evolve 1 on host: eAdd<n=1>, eShow
        > host: evolved 1: #a
            water ← view 1 of eShow, number 2: #a
            frame 1 is done: eAdd<n=1>, eShow; #a: ACounter#a<n=2>()
        > begin 2
        > add: ticked 2: eAdd<n=1>
        > water: ticked 2: no events
            ~hosts ← evolve 2 on host: eAdd<n=1>, eShow
        > host: evolved 2: #a
            water ← view 2 of eShow, number 3: #a
            frame 2 done: eAdd<n=1>, eShow; #a: ACounter#a<n=3>()
            ~hosts ← evolve 3 on host: eShow
        > host: evolved 3: nothing
            water ← view 3 of eShow, number 4: #a
            stopping
            ~all ← stop: the frames are over
        > add: report {'adders': 1, 'added': 1}
        > host: report
        > water: report {'ripples': 2}
            ended: the frames are over {'adders': 1, 'added': 1, 'ripples': 2}
        > add vanished
        > host vanished
        > water vanished
    """)


def test_an_observer_never_holds_a_frame_up():
    bus = started("ACounter#a", members={"screen": service("screen", Screen)}, frames=20, after=0)
    bus.hold(("down", "screen"))
    for _ in range(20):
        bus.frame()
    assert len(bus.records) == 20
    assert bus.algorithm.waiting_for() == ["screen"]  # for its report
    bus.do("release, settle")
    assert bus.ended.reason == "the frames are over"


@pytest.mark.parametrize("lost", [1, 2, 3])
def test_an_observer_that_missed_views_asks_for_a_whole_one(lost):
    bus = started("ACounter#a · ACounter#b", members={"screen": service("screen", Screen)})
    bus.do("hold down screen")
    for _ in range(lost):
        bus.frame()
    for _ in range(lost):
        bus.drop(("down", "screen"))
    bus.do("release, clear, run 1")
    if lost == 1:
        bus.expect("""
        > begin 2
        > add: ticked 2: eAdd<n=1>
            ~hosts ← evolve 2 on host: eAdd<n=1>, eShow
        > host: evolved 2: #a #b
            observers of eShow ← view 2 of eShow, number 3: #a #b
            frame 2 is done: eAdd<n=1>, eShow; #a: ACounter#a<n=3>(), #b: ACounter#b<n=3>()
        > screen: resync eShow
            screen ← view 2 of eShow, number 3: all of #a #b
        """)
    assert shown(bus)[-1] == f"{lost + 1}: PDot<x={lost + 1}> · PDot<x={lost + 1}>"
    bus.run(1)
    assert shown(bus)[-1].startswith(f"{lost + 2}:")


def test_a_repeated_or_late_view_is_not_shown_again():
    bus = started("ACounter#a", members={"screen": service("screen", Screen)}, after=3)
    before = list(shown(bus))
    for sequence in (1, 2, 3):
        bus.alive["screen"].receive(m.ViewShown("eShow", 0, sequence, {}))
    bus.alive["screen"].show()
    assert shown(bus) == before


def test_a_resync_for_what_was_never_shown_or_by_a_stranger_is_ignored():
    bus = started()
    bus.put(m.Resync("host", "eShow"))
    bus.put(m.Resync("stranger", "eShow"))
    bus.put(m.Resync("host", "eNothing"))
    bus.do("settle, run 1")
    assert len(bus.records) == 2


def test_the_last_string_is_shown_at_the_end():
    bus = counters("ACounter#a", members={"screen": service("screen", lambda: Screen(5))}, frames=3)
    bus.start()
    screen = bus.alive["screen"].service
    bus.run()
    assert screen.shown == ["0: PDot<x=0>", "3: PDot<x=3>"]
    # It has not been asked to show each frame.
    assert "views of screen" not in bus.ended.figures


def test_views_that_an_observer_of_each_frame_skips_are_counted():
    bus = started("ACounter#a", members={"screen": service("screen", Screen)}, after=2)
    screen = bus.alive["screen"]
    screen.receive(m.ViewShown("eShow", 6, 9, {}, Scene(())))
    screen.show()
    screen.receive(m.Stop("enough"))
    (skipped,) = [name for name in screen.figures() if name.startswith("views")]
    assert skipped == "views of screen"
    assert screen.figures()[skipped] == "3 of 7 shown; a coupled device misses none"
    # A window or a page shows what is new.
    screen.service.interactive = True
    assert skipped not in screen.figures()


def test_a_guest_that_watches_changes_no_digest():
    bus, plain = counters(), counters()
    bus.start()
    plain.do("start, run 6")
    for n in range(3):
        bus.join(f"look-{n}", service(f"look-{n}", Screen))
        bus.run(1)
        bus.vanish(f"look-{n}")
        bus.run(1)
    assert bus.digests == plain.digests


class Sizes(Device, draws=("eMark",), when="each frame"):
    """Draws events with data, which it cannot create itself."""

    def show(self, view):
        raise AssertionError("nothing to see")


def test_a_device_cannot_be_the_source_of_events_that_need_data():
    from minerva_bus.frame.member_side import Member
    from minerva_bus.frame.world_state import WorldSpec
    from tests.family import FAMILY, FAMILY_VOCABULARY

    members = {"host": lambda: Member("host", None, FAMILY)}
    w = FAMILY_VOCABULARY.read("AWalker#w")
    bus = Bus(WorldSpec("w", w, FAMILY_VOCABULARY, expected=frozenset(members)), members)
    bus.do("start, run 1")
    bus.join("sizes", service("sizes", Sizes))
    bus.run(2)
    assert "host" in bus.alive
    assert "sizes" not in bus.alive
    assert len(bus.records) == 3


def test_a_view_arrives_in_the_order_of_frames_also_for_one_that_lags():
    bus = started("ACounter#a", members={"screen": service("screen", Screen)}, after=0)
    bus.hold(("down", "screen"))
    for _ in range(5):
        bus.do("step begin, settle")
    bus.do("release, settle")
    assert [int(line.split(":")[0]) for line in shown(bus)] == [0, 1, 2, 3, 4]


class Drifter(Agent, symbol="ADrifter"):
    """Member of a population in which few agents move per frame, and births are rare."""

    x: Metres = 0.0
    births: int = 0

    @on("eStep", population=True)
    def drift(self, step, moment):
        self.x = np.where(moment.chance.chance(0.05), self.x + step.count, self.x)
        seldom = moment.number % 5 == 4
        self.bear((np.array(self.id.texts()) == "d7") & seldom, x=9.0)

    @view("eShow", population=True)
    def show(self, event):
        return TAt(self.x)(PDot(1))


DRIFTING = Vocabulary.of(PDot, TAt, eStep, eShow, Drifter)


@pytest.mark.parametrize("hosts", [1, 2])
def test_key_views_and_what_differs_add_up_to_the_view_of_the_whole(hosts):
    """This includes a screen that joins late, and births."""
    w = WorldSpec("drift", Drifter.many("d", 200, x=np.arange(200.0)) + PDot(5), DRIFTING)
    members = {f"h{n}": host(f"h{n}", Drifter) for n in range(hosts)}
    members |= {"steps": service("steps", Steps), "screen": service("screen", Screen)}
    members["late"] = service("late", Screen)
    bus = Bus(replace(w, expected=frozenset(members) - {"late"}), members)
    bus.do("start, vanish late, settle")
    wanted, sent = [], []
    receive = bus.algorithm.receive
    bus.algorithm.receive = lambda stimulus: sent.append(stimulus) or receive(stimulus)
    for frame in range(24):
        if frame == 12:
            bus.do("appear late, settle")
        wanted.append(f"{frame}: {visualize(bus.algorithm.scene, [eShow()], [Drifter])}")
        bus.frame()
    assert shown(bus) == wanted
    assert shown(bus, "late") == wanted[-len(shown(bus, "late")) :]
    assert len(shown(bus, "late")) >= 12
    views = [v for r in sent if isinstance(r, m.EvolveReply) for v in r.views.values()]
    deltas = [each for view in views for each in view.values() if isinstance(each, Delta)]
    assert any(change.rows is not None for delta in deltas for change in delta.changes)
