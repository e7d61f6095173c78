"""Any schedule and any deaths give the same strings, or a stop with a reason.

Never a hang: when no message is pending, the world either has ended or waits for a dead member.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import count
from random import Random

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import HealthCheck, given, note, settings
from pond import (
    VOCABULARY,
    Add,
    Counter,
    Eye,
    Fly,
    Frog,
    Lily,
    Minnow,
    Screen,
    Steps,
    Water,
    host,
    service,
    world,
)

from minerva_bus import Scene
from minerva_bus.frame.member_side import Member
from minerva_bus.frame.stimuli import Abandoned
from tests.memory_bus import MemoryBus
from tests.one_process import run_world

POND = """
    AFrog#f1 · AFrog#f2<x=2> · TAt<x=1>(AFrog#f3 · PDot<x=0>) · AFly#y1 · AFly#y2
    · ALily#l1(AFrog#f4 · AFly#y3) · ALily#l2(TAt<x=3>(AFrog#f5)) · PDot<x=9>
"""
SHOAL = Minnow.many("m", 150, x=np.arange(150.0)) + VOCABULARY.read("AFrog#f1 · PDot<x=9>")
FRAMES = 8


@dataclass(frozen=True)
class Setting:
    """A world, its members, and guests that may join."""

    scene: Scene
    members: dict[str, Callable[[], Member]]
    guests: dict[str, Callable[[], Member]]

    @property
    def world(self):
        return world(self.scene, self.members, frames=FRAMES, seed=5)

    @cached_property
    def undisturbed(self):
        """The digests of a run in one process, and the reason for its end."""
        digests, members = [], [make() for make in self.members.values()]
        runner = run_world(
            self.world, members, lambda done, scene: digests.append(scene.digest.hex())
        )
        return digests, runner.ended


LOOK = service("look", lambda: Screen(2))
NOISE = service("noise", Add)  # for counters, which this world does not contain
SETTINGS = {
    "pond": Setting(
        VOCABULARY.read(POND),
        {
            "eye": service("eye", Eye),
            "frogs": host("frogs", Frog),
            "more": host("more", Frog, Fly),
            "pads": host("pads", Lily, Frog, Fly),
            "screen": service("screen", Screen),
            "steps": service("steps", Steps),
            "water": service("water", Water),
        },
        {"guest": host("guest", Frog, Fly, Lily, Counter), "look": LOOK, "noise": NOISE},
    ),
    "shoal": Setting(
        SHOAL,
        {
            "many": host("many", Minnow),
            "more": host("more", Minnow, Frog),
            "screen": service("screen", Screen),
            "steps": service("steps", Steps),
            "water": service("water", Water),
        },
        {"guest": host("guest", Minnow), "look": LOOK, "noise": NOISE},
    ),
}
both = pytest.mark.parametrize("setting", SETTINGS.values(), ids=SETTINGS)


@dataclass(frozen=True)
class Blow:
    """A member fails after `after` steps, and returns after `back` more (0: never)."""

    after: int
    member: str
    back: int
    how: str = "vanish"


@st.composite
def blows(draw, setting, back, most, guests=True):
    """Members of the world die; guests may also leave gracefully."""
    names = [*setting.members, *(setting.guests if guests else ())]
    leaves = [(g, "leave") for g in setting.guests]
    after = st.integers(0, 200)
    ways = st.sampled_from([(name, "vanish") for name in names] + leaves)
    blow = st.builds(lambda after, way, back: Blow(after, way[0], back, way[1]), after, ways, back)
    return draw(st.lists(blow, max_size=most))


def play(bus, chance, blows, limit=20000):
    """Execute steps in random order until the world ends or no step is possible."""
    due = [(blow.after, blow.how, blow.member, blow.back) for blow in blows]
    for now in range(limit):
        for change in sorted(change for change in due if change[0] <= now):
            due.remove(change)
            _, how, member, back = change
            if (member in bus.alive) is (how != "appear"):
                getattr(bus, how)(member)
                due += [(now + back, "appear", member, 0)] if back else []
        links = bus.ready()
        if links:
            bus.step(chance.choice(links))
        elif bus.ended is not None or not due:
            return
    raise AssertionError("the world goes on for ever")


schedule = settings(max_examples=20, deadline=None, suppress_health_check=list(HealthCheck))
seeds = st.integers(0, 1 << 32)


@both
@schedule
@given(seed=seeds)
def test_any_order_of_messages_gives_the_digests_of_one_process(setting, seed):
    digests, ended = setting.undisturbed
    bus = MemoryBus(setting.world, setting.members)
    bus.start()
    play(bus, Random(seed), [])
    note(bus)
    assert bus.stuck == []
    assert bus.digests == digests
    assert bus.ended.reason == ended.reason


@both
@schedule
@given(seed=seeds, data=st.data())
def test_a_repeated_message_counts_once(setting, seed, data):
    """Requests and replies are repeated, also much later, while members and coordinators die."""
    digests, _ = setting.undisturbed
    bus, chance = MemoryBus(setting.world, setting.members), Random(seed)
    bus.start()
    deaths = sorted(data.draw(st.lists(st.integers(1, 200), max_size=2)))
    step, steps = bus.step, count()

    def twice(link):
        if link[0] in ("up", "down") and chance.random() < 0.2:
            bus.repeat(link)
        step(link)
        if deaths and next(steps) >= deaths[0]:
            deaths.pop(0)
            bus.kill_coordinator()

    bus.step = twice
    play(bus, chance, data.draw(blows(setting, st.integers(1, 60), 6, guests=False)))
    note(bus)
    assert bus.stuck == [] or not deaths
    assert bus.digests == digests


@both
@schedule
@given(seed=seeds, data=st.data())
def test_members_that_die_and_return_change_nothing(setting, seed, data):
    digests, ended = setting.undisturbed
    bus = MemoryBus(setting.world, setting.members | setting.guests)
    bus.start()
    play(bus, Random(seed), data.draw(blows(setting, st.integers(1, 60), 12)))
    note(bus)
    assert bus.stuck == []
    assert bus.digests == digests
    assert bus.ended.reason == ended.reason


@both
@schedule
@given(seed=seeds, data=st.data())
def test_members_that_die_for_good_are_awaited_until_given_up(setting, seed, data):
    digests, ended = setting.undisturbed
    bus = MemoryBus(setting.world, setting.members | setting.guests)
    bus.start()
    fatal = data.draw(blows(setting, st.just(0), 4, guests=False))
    chance, mortal = Random(seed), {blow.member for blow in fatal}
    play(bus, chance, fatal)
    given_up = False
    while bus.ended is None:
        note(bus)
        assert bus.stuck == []
        for name in sorted(mortal - bus.alive.keys()):
            bus.handle(Abandoned(name))
        assert not given_up
        given_up = True
        play(bus, chance, [])
    note(bus)
    assert bus.ended.reason == ended.reason
    assert len(bus.digests) == FRAMES
    if not given_up:
        assert bus.digests == digests
