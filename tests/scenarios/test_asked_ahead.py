"""A generator that is ahead is asked for several frames at once, with the same strings."""

from dataclasses import replace

import pytest
from pond import Forward, Snail, eStep, host, service, world

from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.collection import FEW_EVENTS
from minerva_bus.frame.generating import MAX_AHEAD
from minerva_bus.frame.member import Member
from minerva_bus.runtime.runner import Sink
from minerva_bus.testing.memory_bus import BEGIN, MemoryBus

FRAMES = 30
FORWARD = service("steps", Forward)
TEXT = "ASnail#a · ASnail#b<x=2>"


class Ticks(Sink):
    """Notes the ticks that are sent together, each with the frame in which it is sent."""

    def __init__(self):
        self.sent = []

    def decided(self, stimulus, instructions):
        frame = self.runner.algorithm.frame
        sent = [order.message for order in instructions if isinstance(order, s.Send)]
        asked = [(frame, tick.frame) for tick in sent if isinstance(tick, m.TickRequest)]
        self.sent += [asked] if asked else []

    @property
    def all(self):
        return [each for sent in self.sent for each in sent]

    @property
    def most_ahead(self):
        return max(asked - frame for frame, asked in self.all)


class Unsaved(Forward):
    """Has a state that it does not save: only answers that it repeats can be those of before."""

    def save(self):
        return None


class Many(Forward):
    """Sends many events from frame 2 on."""

    def generate(self, tick):
        (step,) = super().generate(tick)
        more = FEW_EVENTS + 1 if tick.number >= 2 else 1
        return [eStep(step.count + n) for n in range(more)]


class KeepsTwo(Member):
    """A member that keeps two answers, as those in other languages."""

    def hello(self):
        return replace(super().hello(), kept=2)


def bus_of(steps=FORWARD, frames=FRAMES):
    members = {"snails": host("snails", Snail), "steps": steps}
    ticks = Ticks()
    bus = MemoryBus(world(TEXT, members, frames=frames, seed=2), members, [ticks])
    bus.start()
    return bus, ticks


def undisturbed(steps=FORWARD):
    bus, _ = bus_of(steps)
    bus.run()
    return bus.digests


def test_each_frame_is_requested_once_in_order_and_several_together():
    bus, ticks = bus_of()
    bus.run()
    assert [asked for _, asked in ticks.all] == list(range(FRAMES))
    assert ticks.most_ahead == MAX_AHEAD
    # The first frame is asked singly, before it is known that the generator has few events.
    assert min(map(len, ticks.sent[1:-1])) >= MAX_AHEAD // 2


def test_frames_after_the_last_one_are_not_requested():
    bus, ticks = bus_of(frames=5)
    bus.run()
    assert [asked for _, asked in ticks.all] == list(range(5))


def test_a_generator_that_keeps_two_answers_is_asked_one_frame_ahead():
    bus, ticks = bus_of(lambda: KeepsTwo("steps", Forward()))
    bus.run()
    assert ticks.most_ahead == 1
    assert bus.digests == undisturbed()


def test_a_world_whose_frames_have_their_own_times_asks_one_frame_ahead():
    bus, ticks = bus_of()
    while bus.ended is None:
        link = next((link for link in bus.ready() if link != BEGIN), None)
        bus.step(link) if link else bus.handle(s.Begin())
    assert ticks.most_ahead == 1
    assert bus.digests == undisturbed()


def test_many_events_are_requested_one_frame_ahead():
    bus, ticks = bus_of(service("steps", Many), frames=14)
    bus.run()
    assert [asked for _, asked in ticks.all] == list(range(14))
    assert ticks.most_ahead == MAX_AHEAD
    singly = [asked for asked in ticks.all if asked[1] > 1 + MAX_AHEAD]
    assert [asked - frame for frame, asked in singly] == [1] * (14 - 2 - MAX_AHEAD)


@pytest.mark.parametrize("steps", [FORWARD, service("steps", Unsaved)])
def test_a_successor_gets_the_same_answers_again(steps):
    expected, count = undisturbed(steps), 0
    while True:
        bus, _ = bus_of(steps)
        for _ in range(count):
            if bus.ended is None:
                bus.step(next((link for link in bus.ready() if link != BEGIN), BEGIN))
        if bus.ended is not None:
            break
        bus.kill_coordinator()
        bus.run()
        assert bus.digests == expected, f"killed after step {count}"
        count += 3
    assert count > 3 * FRAMES


def test_a_generator_that_is_killed_continues_from_the_frame_in_progress():
    expected, count = undisturbed(), 0
    while count < 3 * FRAMES:
        bus, _ = bus_of()
        for _ in range(count):
            bus.step(next((link for link in bus.ready() if link != BEGIN), BEGIN))
        bus.restart("steps")
        bus.run()
        assert bus.digests == expected, f"killed after step {count}"
        count += 1


def test_replies_that_were_not_requested_are_late():
    bus, _ = bus_of()
    bus.run(3)
    steps = bus.algorithm.members.get("steps")
    for frame in (0, bus.algorithm.inbox.early.last_asked("steps") + 1):
        late = steps.late
        bus.handle(m.TickReply("steps", frame))
        assert steps.late == late + 1
    bus.run()
    assert bus.digests == undisturbed()
