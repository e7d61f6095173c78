"""Several processes divide the agents of a generator: nothing in the world depends on how many."""

from functools import partial

import numpy as np
import pytest
from pond import Add, Bus, Counter, eAdd, host, service, world

from minerva_bus import Generator
from minerva_bus.frame.member_side import Member
from minerva_bus.grammar.ids import Ids
from minerva_bus.launch.process_specs import names_of
from minerva_bus.world.context import stream
from minerva_bus.world.norms import Norm
from minerva_bus.world.readings import Sighting, Sightings
from tests.memory_bus import BEGIN

WHO = ("a", "c10", "c9", "b")
"""Not in the order of their ids, which is that of the events."""
STRING = " · ".join(f"ACounter#{who}<n=-9999>" for who in WHO)
FRAMES = 6


class Sonar(Generator, events=("eAdd",)):
    """Measures each agent by itself, and has state."""

    by_agent = True
    publishes = ("sight",)

    def __init__(self):
        self.count = 0

    def generate(self, tick):
        self.count += 1
        for who in WHO:
            drawn = stream(tick.frame.seed, f"{tick.who}/{who}", tick.number).integers(9)
            tick.publish("sight", Sightings(who, (Sighting("m", float(drawn), 0.0),), tick.time))
            yield eAdd(int(drawn) * self.count, receivers=(who,))

    def save(self):
        return self.count

    def restore(self, saved):
        self.count = saved


class Batches(Sonar):
    def generate(self, tick):
        made = [*super().generate(tick), *super().generate(tick)]
        to = [who for event in made for who in event.receivers]
        return eAdd(n=np.array([event.n for event in made]), receivers=Ids.of(to))


class Ear(Generator, events=("eAdd",)):
    """Makes events from the readings of its agents."""

    by_agent = True
    topics = ("sight",)

    def generate(self, tick):
        return [eAdd(int(each.seen[0].distance), receivers=(each.robot,)) for each in tick.readings]


class Observer(Ear):
    """Depends on the order of all readings."""

    by_agent = False

    def generate(self, tick):
        return eAdd(sum(n * int(r.seen[0].distance) for n, r in enumerate(tick.readings)))


def divided(name, make, count):
    names = tuple(names_of(name, count))

    def member(each):
        made = Member(each, make())
        if count > 1:
            made.divide(name, names)
        return made

    return {each: partial(member, each) for each in names}


def bus_of(count, make=Sonar, **rest):
    sonars, ears = divided("sonar", make, count), divided("ear", Ear, count)
    members = {**sonars, **ears, "host": host("host", Counter)}
    members["observer"] = service("observer", Observer)
    shares = dict.fromkeys(sonars, "sonar") | dict.fromkeys(ears, "ear")
    bus = Bus(world(STRING, members, frames=FRAMES, shares=shares, **rest), members)
    bus.start()
    return bus


def frames(bus):
    """Events and changes of each frame, and the digests."""
    return [line for line in bus.trace if line.strip().startswith("frame ")], bus.digests


@pytest.mark.parametrize("make", [Sonar, Batches])
@pytest.mark.parametrize("count", [2, 3])
def test_strings_and_events_are_those_of_one_process(make, count):
    one, several = bus_of(1, make), bus_of(count, make)
    for bus in (one, several):
        bus.run()
    assert frames(several) == frames(one)
    assert len(one.digests) == FRAMES


@pytest.mark.parametrize("kills", [("sonar-1",), ("ear-2",), ("sonar-1", "sonar-2", "host"), ()])
def test_any_death_gives_the_same_strings(kills):
    undisturbed, count = bus_of(1), 0
    undisturbed.run()
    while True:
        bus = bus_of(2)
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
        assert bus.digests == undisturbed.digests, f"killed after step {count}"
        count += 5
    assert count > 3 * FRAMES


def test_a_frame_waits_for_the_share_of_one_that_is_killed():
    bus = bus_of(2).do("run 1, clear, hold up sonar-2, frame, settle, vanish sonar-2, settle")
    bus.do("appear sonar-2, release, settle").expect("""
        > begin
        ~tick ← tick 1
        > sonar-1: ticked 1: eAdd<n=10> to #a, eAdd<n=10> to #c10, eAdd<n=6> to #c9
        > sonar-2 vanished
        says sonar-2: is gone; the world waits for it
        > ear-1: ticked 1: eAdd<n=5> to #a, eAdd<n=4> to #b, eAdd<n=3> to #c9
        > ear-2: ticked 1: eAdd<n=5> to #c10
        > observer: ticked 1: eAdd<n=23>
        > sonar-2: ticked 1: eAdd<n=8> to #b
        > sonar-2 appeared
        sonar-2 ← greet
        > sonar-2: hello, generator
        sonar-2 ← welcome to frame 1, saved {'=': 1}
        sonar-2 ← sources: sight by sonar-1, sonar-2
        sonar-2 ← tick 1
        > sonar-2: ticked 1: eAdd<n=8> to #b
        ~hosts ← evolve 1 on host: eAdd<n=5> to #a, eAdd<n=4> to #b, eAdd<n=5> to #c10, eAdd<n=3> to #c9, eAdd<n=23>, eAdd<n=10> to #a, eAdd<n=8> to #b, eAdd<n=10> to #c10, eAdd<n=6> to #c9
        > host: evolved 1: #a #b #c10 #c9
        frame 1 done: eAdd<n=5> to #a, eAdd<n=4> to #b, eAdd<n=5> to #c10, eAdd<n=3> to #c9, eAdd<n=23>, eAdd<n=10> to #a, eAdd<n=8> to #b, eAdd<n=10> to #c10, eAdd<n=6> to #c9; #a: ACounter#a<n=-9928>(), #b: ACounter#b<n=-9934>(), #c10: ACounter#c10<n=-9927>(), #c9: ACounter#c9<n=-9932>()
        ready for frame 2
    """)


def test_norms_know_the_generator_by_its_name():
    norm = Norm("small", ("sonar",), on=("eAdd",), when="event.n > 20")
    one, three = bus_of(1, norms=(norm,)), bus_of(3, norms=(norm,))
    for bus in (one, three):
        bus.run()
    assert three.digests == one.digests != bus_of(1).do("run").digests


def test_no_guest_takes_the_name_of_the_generator():
    bus = bus_of(2).do("run 1, clear")
    bus.join("sonar", service("sonar", Add))
    bus.settle()
    assert any("refused: processes of the world divide" in line for line in bus.trace)


class Drawing(Ear):
    def generate(self, tick):
        return eAdd(int(tick.random.integers(9)), receivers=("a",))


class Calling(Ear):
    def generate(self, tick):
        return eAdd(1)


@pytest.mark.parametrize("make", [Drawing, Calling])
def test_what_depends_on_the_number_of_processes_is_an_error(make):
    assert len(bus_of(1, make).do("run").digests) == FRAMES
    trace = bus_of(2, make).do("run 1").trace
    assert any(
        "several processes divide the agents; see Generator.by_agent" in line for line in trace
    )
