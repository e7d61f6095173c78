"""A world resumed from a checkpoint has the same future as one that never stopped."""

from dataclasses import replace

import pytest
from pond import VOCABULARY, Bus, Counter, Fly, Frog, Lily, Minnow, counters, started
from test_any_schedule import FRAMES, SETTINGS, both

from minerva_bus.errors import ProtocolError
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.messages import ViewShown
from minerva_bus.world.agent import kinds_of
from minerva_bus.world.visualization import visualize

KINDS = kinds_of([Counter, Fly, Frog, Lily, Minnow])


def resumed(world, bus, before, members):
    """Resume the world of a bus between two frames on a new bus; `before` is its last w."""
    algorithm, record = bus.algorithm, bus.records[-1]
    shows = [event for event in record.events if VOCABULARY.events[event.type].visual]
    past = algorithm.checkpoint
    last = visualize(before, shows, KINDS, record.frame)
    view = ViewShown("eShow", record.frame, past.frame, {}, last)
    past = replace(world, scene=algorithm.scene, past=past, shown=[view])
    return Bus(past, members).do("start, run")


@both
@pytest.mark.parametrize("stop", range(1, FRAMES))
def test_it_goes_on_from_any_frame(setting, stop):
    bus = Bus(setting.world, setting.members).do(f"start, run {stop - 1}")
    before = bus.algorithm.scene
    bus.run(1)
    assert bus.algorithm.checkpoint.frame == stop
    digests, ended = setting.undisturbed
    again = resumed(setting.world, bus, before, setting.members)
    assert again.digests == digests[stop:]
    assert again.ended.reason == ended.reason


def test_it_needs_no_more_hosts_than_before():
    setting = SETTINGS["pond"]
    bus = Bus(setting.world, setting.members).do("start, run 3")
    before = bus.algorithm.scene
    bus.run(1)
    fewer = {name: member for name, member in setting.members.items() if name != "more"}
    world = replace(setting.world, expected=frozenset(fewer))
    assert resumed(world, bus, before, fewer).digests == setting.undisturbed[0][4:]


def test_a_coupled_device_acts_on_the_view_of_before():
    setting = SETTINGS["pond"]
    bus = Bus(setting.world, setting.members).do("start, run 4")
    past = replace(setting.world, scene=bus.algorithm.scene, past=bus.algorithm.checkpoint)
    blind = Bus(past, setting.members).do("start, run")
    assert blind.digests != setting.undisturbed[0][4:]


def test_a_reached_end_counts_after_resuming():
    bus = started("ACounter#a<n=5> · ACounter#b", after=4, until="eDone", frames=20)
    checkpoint = bus.algorithm.checkpoint
    assert (checkpoint.reached, checkpoint.reaching) == ({"a"}, {"ACounter"})
    past = replace(bus.algorithm.world, scene=bus.algorithm.scene, past=checkpoint)
    again = Bus(past, bus.makers).do("start, run")
    bus.run()
    assert again.ended == bus.ended
    assert again.ended.reason == "every agent has sent eDone"
    assert again.digests == bus.digests[4:]


def test_a_world_that_had_reached_its_last_frame_ends_without_another():
    bus = counters(frames=3).do("start, run 2, hold up host, frame")
    bus.handle(s.Skip("host"))
    past = replace(bus.algorithm.world, scene=bus.algorithm.scene, past=bus.algorithm.checkpoint)
    again = Bus(past, bus.makers).do("start, run")
    assert (again.ended.reason, again.records) == ("the frames are over", [])


def test_inputs_repeat_their_own_frame_only():
    bus = counters().do("start, run 3")
    again = FrameAlgorithm(bus.algorithm.world)
    again.receive(s.Begin(inputs=bus.inputs[0]))
    for number in (0, 2):
        with pytest.raises(ProtocolError, match=f"inputs of frame 1, got frame {number}"):
            again.receive(s.Begin(inputs=bus.inputs[number]))
