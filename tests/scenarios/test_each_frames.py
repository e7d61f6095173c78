"""A generator that draws nothing may be asked in each n-th frame only."""

import pytest
from pond import Add, Counter, Steps, host, service, world

from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.runtime.runner import Sink
from tests.memory_bus import BEGIN, MemoryBus

FRAMES = 9


class Third(Steps, when="each 3 frames"):
    pass


class ByHand(Steps):
    """The same generator, which leaves frames out itself."""

    def generate(self, tick):
        return () if tick.number % 3 else super().generate(tick)


class Ticks(Sink):
    """Notes the frames for which members are asked, by address."""

    def __init__(self):
        self.asked = []

    def decided(self, stimulus, instructions):
        sent = [order for order in instructions if isinstance(order, s.Send)]
        self.asked += [
            (o.to, o.message.frame) for o in sent if isinstance(o.message, m.TickRequest)
        ]


def bus_of(steps, frames=FRAMES):
    members = {"add": service("add", Add), "host": host("host", Counter), "steps": steps}
    ticks = Ticks()
    bus = MemoryBus(world("ACounter#a · ACounter#b", members, frames=frames), members, [ticks])
    bus.start()
    return bus, ticks


def undisturbed():
    bus, _ = bus_of(service("steps", ByHand))
    bus.run()
    return bus.digests


def test_it_is_asked_in_these_frames_by_its_name():
    bus, ticks = bus_of(service("steps", Third))
    bus.run()
    assert [frame for to, frame in ticks.asked if to == "steps"] == [0, 3, 6]
    assert [frame for to, frame in ticks.asked if to == s.TICKED] == list(range(FRAMES))
    assert bus.digests == undisturbed()


@pytest.mark.parametrize("kills", [("steps",), (), ("steps", "host")])
def test_any_death_gives_the_same_strings(kills):
    expected, count = undisturbed(), 0
    while True:
        bus, _ = bus_of(service("steps", Third))
        for _ in range(count):
            if bus.ended is None:
                bus.step(next((link for link in bus.ready() if link != BEGIN), BEGIN))
        if bus.ended is not None:
            break
        for name in kills:
            bus.restart(name)
        if not kills:
            bus.kill_coordinator()
        bus.run()
        assert bus.digests == expected, f"killed after step {count}"
        count += 2
    assert count > 2 * FRAMES


def test_frames_without_it_go_on_while_it_is_away():
    expected = undisturbed()
    for dies_before in range(FRAMES):
        bus, ticks = bus_of(service("steps", Third))
        bus.run(dies_before)
        bus.vanish("steps")
        bus.run()
        assert bus.algorithm.frame == dies_before + -dies_before % 3
        bus.appear("steps")
        bus.run()
        assert bus.digests == expected, f"away before frame {dies_before}"
        assert [frame for to, frame in ticks.asked if to == "steps"] == [0, 3, 6]


def test_a_world_with_it_is_not_at_rest():
    members = {"host": host("host", Counter), "steps": service("steps", Third)}
    bus = MemoryBus(world("ACounter#a", members), members)
    bus.start()
    for _ in range(4):
        bus.run(1)
        assert not bus.algorithm.at_rest
