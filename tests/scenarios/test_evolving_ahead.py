"""A host of agents that send no events is asked for the next frame early, with the same strings."""

from collections.abc import Callable

import pytest
from pond import (
    Add,
    Counter,
    Forward,
    Screen,
    Snail,
    Steps,
    eAdd,
    eCroak,
    eSeen,
    host,
    service,
    world,
)

from minerva_bus import Agent, evolve, on
from minerva_bus.errors import MisuseError
from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.member import Member
from minerva_bus.runtime.direct import InProcessRunner
from minerva_bus.runtime.runner import Sink
from minerva_bus.testing.memory_bus import BEGIN, MemoryBus
from minerva_bus.world.norms import Norm
from minerva_bus.world.policy import Policy

TEXT = "ASnail#a · ASnail#b<x=2>"
MEMBERS = {"snails": host("snails", Snail), "steps": service("steps", Forward)}
FRAMES = 12
SEED = 2
"""Without births and deaths."""
UP = ("up", "snails")


class Asked(Sink):
    """Notes each request to hosts, with the frame in which it is sent."""

    def __init__(self) -> None:
        self.sent: list[tuple[int, m.EvolveRequest]] = []

    def decided(self, stimulus: s.Stimulus, instructions: list[s.Instruction]) -> None:
        self.sent += [
            (self.runner.algorithm.frame, order.message)
            for order in instructions
            if isinstance(order, s.Send) and isinstance(order.message, m.EvolveRequest)
        ]

    @property
    def early(self) -> list[int]:
        """The frames that were requested before they began."""
        return [asked.frame for frame, asked in self.sent if asked.frame > frame]

    @property
    def parts(self) -> dict[int, list[int]]:
        """The numbers of the parts of each frame."""
        parts: dict[int, list[int]] = {}
        for _, asked in self.sent:
            parts.setdefault(asked.frame, []).append(asked.part)
        return parts


class Garden:
    """A world of snails, in which the host is slower than the generator."""

    def __init__(self, members: dict[str, Callable[[], Member]] | None = None, **rest: object):
        members = MEMBERS if members is None else members
        self.asked = Asked()
        described = world(
            rest.pop("text", TEXT), members, **{"frames": FRAMES, "seed": SEED, **rest}
        )
        self.world = described
        self.bus = MemoryBus(described, members, [self.asked])
        self.bus.start()
        self.bus.settle()

    def frame(self, between: Callable[[], None] = lambda: None) -> None:
        """A frame in which the clock answers for the next one before the host for this one."""
        bus, frame = self.bus, self.bus.algorithm.frame
        bus.hold(UP)
        bus.frame()
        between()
        # The answer to an early request stays on its way.
        while bus.algorithm.frame == frame and UP in bus.ready():
            bus.step(UP)
            bus.settle()
        if bus.algorithm.frame == frame or bus.algorithm.over:
            bus.release()
            bus.settle()

    def run(self) -> list[str]:
        while self.bus.ended is None:
            self.frame()
        return self.bus.digests


def in_process(described, members=MEMBERS, orders=()):
    """The digests in one process; `orders`: events of people by frame."""
    digests = []

    def watch(notice):
        if isinstance(notice, s.FrameDone):
            digests.append(notice.record.digest.hex())

    algorithm = FrameAlgorithm(described)
    runner = InProcessRunner(algorithm, [make() for make in members.values()], watch)
    runner.start()
    while runner.ended is None:
        for event in dict(orders).get(algorithm.frame, ()):
            runner.handle(s.Publish(event))
        runner.handle(s.Begin())
    return digests


def test_each_frame_but_the_first_is_requested_while_the_one_before_evolves():
    garden = Garden()
    assert garden.run() == in_process(garden.world)
    assert garden.asked.early == list(range(1, FRAMES))
    assert set(map(tuple, garden.asked.parts.values())) == {(0,)}


def test_births_and_deaths_make_an_early_request_void():
    garden = Garden(seed=6)
    assert garden.run() == in_process(garden.world)
    assert [frame for frame, parts in garden.asked.parts.items() if parts == [0, 1]] == [2, 6, 10]
    assert garden.asked.early == [1, 2, 5, 6, 9, 10]


def test_a_reply_may_arrive_before_its_frame_begins():
    garden = Garden()
    while garden.bus.ended is None:
        garden.bus.frame()  # Nothing is held: the host answers early requests at once.
    assert garden.bus.digests == in_process(garden.world)
    assert garden.bus.stuck == []


def test_an_order_makes_the_early_request_void():
    garden, order = Garden(), eSeen(3)
    garden.frame()
    garden.frame(lambda: garden.bus.handle(s.Publish(order)))
    assert garden.asked.early == [1, 2]
    garden.run()
    assert garden.bus.digests == in_process(garden.world, orders={2: [order]}.items())
    # Asked early without use, then a further part; then an interval without early requests.
    assert garden.asked.parts[2] == [0, 1]
    assert garden.asked.early[2] > 3


def test_an_order_that_concerns_no_agent_makes_it_void_too():
    garden, order = Garden(), eCroak(3.0)
    garden.frame(lambda: garden.bus.handle(s.Publish(order)))
    garden.run()
    assert garden.bus.digests == in_process(garden.world, orders={1: [order]}.items())


def test_a_host_that_is_skipped_starts_over():
    """It evolves the frame in which it is skipped, and the next one, whose result is not used."""
    digests = []
    for at_once in (True, False):
        garden = Garden() if at_once else frames_at_their_own_times()
        garden.frame()
        garden.frame(lambda bus=garden.bus: bus.handle(s.Skip("snails")))
        assert (garden.asked.early == [1, 2]) is at_once
        digests.append(garden.run())
    assert digests[0] == digests[1]
    assert digests[0] != in_process(garden.world)


@pytest.mark.parametrize("joins", ["guest", "look", "noise"])
def test_a_member_that_joins_changes_nothing(joins):
    makers = {
        "guest": host("guest", Snail),
        "look": service("look", Screen),
        "noise": service("noise", Add),
    }
    garden = Garden()

    def join():
        garden.bus.makers[joins] = makers[joins]
        garden.bus.appear(joins)
        garden.bus.settle()

    garden.frame()
    garden.frame(join)
    assert garden.run() == in_process(garden.world)


def test_a_view_shows_the_string_with_which_its_frame_began():
    members = {**MEMBERS, "look": service("look", lambda: Screen(4))}
    garden = Garden(members)
    look = garden.bus.alive["look"].service
    assert garden.run() == in_process(garden.world, members)
    alone = members["look"]()
    in_process(garden.world, {**members, "look": lambda: alone})
    assert look.shown == alone.service.shown
    early = garden.asked.early
    assert early
    assert not {0, 4, 8} & set(early)


def test_the_last_frame_is_followed_by_none():
    garden = Garden(frames=3)
    garden.run()
    assert max(garden.asked.parts) == 2


def steps_that_depend_on_the_world():
    return Garden({**MEMBERS, "steps": service("steps", Steps)})


def agents_that_may_send():
    members = {**MEMBERS, "snails": host("snails", Snail, Counter)}
    return Garden(members, text=f"{TEXT} · ACounter#c")


def another_policy():
    return Garden(policy=Policy.LITERAL)


def with_a_norm():
    return Garden(norms=(Norm("far", on=("eStep",), when="event.count > 1000"),))


def frames_at_their_own_times():
    garden = Garden()
    step = garden.bus.step
    garden.bus.step = lambda link: garden.bus.handle(s.Begin()) if link == BEGIN else step(link)
    return garden


@pytest.mark.parametrize(
    "make",
    [
        steps_that_depend_on_the_world,
        agents_that_may_send,
        another_policy,
        with_a_norm,
        frames_at_their_own_times,
    ],
)
def test_no_frame_that_may_depend_on_more_is_requested_early(make):
    garden = make()
    garden.frame()
    garden.frame()
    assert garden.asked.early == []


class Loud(Agent, symbol="ALoud", ahead=True):
    @on("eAdd")
    def add(self, add, moment):
        moment.emit(eCroak(1.0))


class Quiet(Loud, symbol="AQuiet"):
    """Inherits `ahead`."""


class Free(Loud, symbol="AFree", ahead=False):
    """Does not."""


@pytest.mark.parametrize("agents", [Loud("a").string, Loud.many("a", 40), Quiet("a").string])
def test_agents_that_are_ahead_send_no_events(agents):
    cls = Quiet if "AQuiet" in str(agents) else Loud
    with pytest.raises(MisuseError, match=r"sent eCroak in frame 0, .* remove ahead=True"):
        evolve(agents, [eAdd(1)], [cls])
    assert Free.kind.ahead is False
    assert evolve(Free("a").string, [eAdd(1)], [Free]).emitted
