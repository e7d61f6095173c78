"""Whatever the order of messages, and whoever dies when: the same strings, or a stop with a reason.

Never a hang: when nothing is under way, either the world is over or it waits for a dead member.
"""

from dataclasses import dataclass
from random import Random

import hypothesis.strategies as st
from hypothesis import HealthCheck, given, note, settings
from pond import Add, Counter, Eye, Fly, Frog, Lily, Screen, Steps, Water, host, service, world

from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.stimuli import Begin, FrameDone, GaveUp
from minerva_bus.launch.inprocess import InProcess
from minerva_bus.testing.memory_bus import MemoryBus

STRING = """
    AFrog#f1 · AFrog#f2<x=2> · TAt<x=1>(AFrog#f3 · PDot<x=0>) · AFly#y1 · AFly#y2
    · ALily#l1(AFrog#f4 · AFly#y3) · ALily#l2(TAt<x=3>(AFrog#f5)) · PDot<x=9>
"""
FRAMES = 8
MEMBERS = {
    "eye": service("eye", Eye),
    "frogs": host("frogs", Frog),
    "more": host("more", Frog, Fly),
    "pads": host("pads", Lily, Frog, Fly),
    "screen": service("screen", Screen),
    "steps": service("steps", Steps),
    "water": service("water", Water),
}
GUESTS = {
    "guest": host("guest", Frog, Fly, Lily, Counter),
    "look": service("look", lambda: Screen(2)),
    "noise": service("noise", Add),  # for counters, of which there are none
}
NAMES = sorted({*MEMBERS, *GUESTS})


def pond():
    return world(STRING, MEMBERS, frames=FRAMES, seed=5)


def undisturbed():
    """The digests of a run in one process, and its members' figures."""
    found = []

    def watch(instruction):
        if isinstance(instruction, FrameDone):
            found.append(instruction.record.digest.hex())

    runner = InProcess(FrameAlgorithm(pond()), [make() for make in MEMBERS.values()], watch)
    runner.start()
    while runner.ended is None:
        runner.tell(Begin())
    return found, runner.ended


DIGESTS, ENDED = undisturbed()


@dataclass(frozen=True)
class Blow:
    """After so many steps a member goes, and comes back after so many more (or not: 0)."""

    after: int
    member: str
    back: int
    how: str = "vanish"


def blows(members, back, most):
    """Members of the world die; guests may also take their leave."""
    ways = st.sampled_from([(one, "vanish") for one in members] + [(g, "leave") for g in GUESTS])
    after = st.integers(0, 200)
    one = st.builds(lambda after, way, back: Blow(after, way[0], back, way[1]), after, ways, back)
    return st.lists(one, max_size=most)


def play(bus, chance, blows, limit=20000):
    """Let things happen in any order until the world is over or nothing can happen."""
    due = [(blow.after, blow.how, blow.member, blow.back) for blow in blows]
    for now in range(limit):
        for one in sorted(one for one in due if one[0] <= now):
            due.remove(one)
            _, how, member, back = one
            if (member in bus.alive) is (how != "appear"):
                getattr(bus, how)(member)
                due += [(now + back, "appear", member, 0)] if back else []
        links = bus.ready()
        if links:
            bus.step(chance.choice(links))
        elif bus.ended is not None or not due:
            return
    raise AssertionError("the world goes on for ever")


schedule = settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
seeds = st.integers(0, 1 << 32)


@schedule
@given(seeds)
def test_any_order_of_messages_gives_the_digests_of_one_process(seed):
    bus = MemoryBus(pond(), MEMBERS)
    bus.start()
    play(bus, Random(seed), [])
    note("\n".join(bus.trace))
    assert bus.stuck == []
    assert bus.digests == DIGESTS
    assert bus.ended.reason == ENDED.reason


@schedule
@given(seeds, blows([*MEMBERS, *GUESTS], st.integers(1, 60), 12))
def test_members_that_die_and_come_back_change_nothing(seed, blows):
    bus = MemoryBus(pond(), MEMBERS | GUESTS)
    bus.start()
    play(bus, Random(seed), blows)
    note("\n".join(bus.trace))
    assert bus.stuck == []
    assert bus.digests == DIGESTS
    assert bus.ended.reason == ENDED.reason


@schedule
@given(seeds, blows(MEMBERS, st.just(0), 4))
def test_members_that_die_for_good_are_waited_for_until_they_are_given_up(seed, blows):
    bus = MemoryBus(pond(), MEMBERS | GUESTS)
    bus.start()
    chance, mortal = Random(seed), {blow.member for blow in blows}
    play(bus, chance, blows)
    given_up = False
    while bus.ended is None:
        note("\n".join(bus.trace))
        assert bus.stuck == []
        for name in sorted(mortal - bus.alive.keys()):
            bus.tell(GaveUp(name))
        assert not given_up
        given_up = True
        play(bus, chance, [])
    note("\n".join(bus.trace))
    assert bus.ended.reason == ENDED.reason
    assert len(bus.digests) == FRAMES
    if not given_up:
        assert bus.digests == DIGESTS
