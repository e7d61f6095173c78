"""A world in which nothing happens rests until an event occurs."""

import signal
from contextlib import suppress

import pytest
from pond import Add, Screen, eAdd, service, started

from minerva_bus.errors import RecordError
from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.log.record import Record
from minerva_bus.runtime.pace import Pace, ViewClock
from tests.runtime.running import World, eventually, write_world


class Bell(Add, when="freely"):
    """Adds when it is triggered."""


def resting(text="ACounter#a<n=6>", *, frames=0, **more):
    return started(text, members={"add": service("add", Bell), **more}, frames=frames, after=2)


def test_it_rests_until_an_event_waits_and_while_agents_answer_one_another():
    bus = resting()
    assert bus.algorithm.at_rest
    bus.handle(m.Emitted("add", (eAdd(1),)))
    assert not bus.algorithm.at_rest
    bus.run(1)
    assert not bus.algorithm.at_rest  # At 7 a counter sends eDone for the next frame.
    bus.run(1)
    assert bus.algorithm.at_rest
    bus.expect("""
        > add: emitted eAdd<n=1>
        > begin
            host ← fragments #a
            ~hosts ← evolve 2 on host: eAdd<n=1>
        > host: evolved 2: #a, emitting eDone from #a
            frame 2 is done: eAdd<n=1>; #a: ACounter#a<n=7>()
        > begin
            frame 3 is done: eDone from #a; no change
    """)


def test_an_order_ends_the_rest():
    bus = resting()
    bus.handle(s.Publish(eAdd(3)))
    assert not bus.algorithm.at_rest
    bus.run(2)
    assert bus.algorithm.at_rest


@pytest.mark.parametrize("every", [1, 3])
def test_it_rests_when_every_device_has_seen_what_has_changed(every):
    screen = Screen(every)
    bus = resting(screen=service("screen", lambda: screen))
    bus.handle(s.Publish(eAdd(1)))
    while not bus.algorithm.at_rest:
        bus.run(1)
        assert len(bus.records) < 20
    assert screen.shown[-1].endswith("PDot<x=7>")


def test_a_world_with_a_rhythm_of_its_own_never_rests():
    bus = started(after=2)
    assert not bus.algorithm.at_rest


def test_nor_does_one_of_a_number_of_frames():
    assert not resting(frames=9).algorithm.at_rest


@pytest.mark.parametrize(
    ("pace", "view", "due"),
    [
        (Pace(), float("inf"), 7.1),
        (Pace(), 7.04, 7.04),  # a view by the clock
        (Pace(rate=50.0), float("inf"), 7.0),
        (Pace(left=3), float("inf"), 7.0),  # steps
    ],
)
def test_at_rest_the_next_frame_waits_a_tenth_of_a_second(pace, view, due):
    assert pace.rest(7.0, view) == due


def test_when_the_first_view_by_the_clock_is_due():
    glances, rates = ViewClock(), {"eShow": 19.0, "eSlow": 1.0}
    assert glances.next({}) == float("inf")
    assert glances.due(100.0, rates) == ("eShow", "eSlow")
    assert glances.next(rates) == pytest.approx(100.05)
    assert glances.due(glances.next(rates), rates) == ("eShow",)


def test_on_the_bus_a_world_at_rest_makes_few_frames(tmp_path):
    members = '[process.walkers]\nagents = "yard:Walker"\n'
    with World(write_world(tmp_path, members, frames=0)) as world, world.client() as asked:
        world.runs("walkers")
        # Without rest it would run thousands of frames per second.
        eventually(lambda: 0 < asked.operator.status().hz < 100, "it rests")
        rested = asked.operator.status().frame
        eventually(lambda: asked.operator.status().frame > rested + 3, "and goes on all the same")


def test_in_one_process_too(tmp_path):
    members = '[process.noise]\nservice = "yard:Noise"\n[process.walkers]\nagents = "yard:Walker"\n'
    path = write_world(tmp_path, members, frames=0)
    with World(path, "--in-process", "--record", "rest.mcap", "--flush", "0.1") as world:
        resting: list[bool] = []

        def seen():
            with suppress(RecordError), Record(tmp_path / "rest.mcap") as record:
                resting[:] = [bool(frame.events) for frame in record.frames()]
            return sum(resting) > 20

        eventually(seen, "noise, fifty times a second")
        world.kill(signal.SIGINT)
        assert world.ends() == 130
    assert len(resting) < 10 * sum(resting)
