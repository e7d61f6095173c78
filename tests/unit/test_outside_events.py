"""Events from outside of all regions: generators that run freely, people, and who is refused."""

import signal
import time
from functools import partial
from pathlib import Path

import pytest

from minerva_bus import Generator, Vocabulary, on
from minerva_bus.errors import WorldStopped
from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.checkpoint import Checkpoint
from minerva_bus.frame.description import World
from minerva_bus.frame.inbox import FrameInbox
from minerva_bus.frame.member import Member
from minerva_bus.frame.orders import refusal_of_order
from minerva_bus.grammar.scene import Scene
from minerva_bus.grammar.symbols import EventType
from minerva_bus.launch.console import Console
from minerva_bus.launch.regions.division import outside_of
from minerva_bus.launch.regions.layout import in_regions, source_of
from minerva_bus.launch.regions.run import RegionRun
from minerva_bus.launch.worldfile import Process, WorldFile
from minerva_bus.log.entries import part_codec
from minerva_bus.regions.outside import OutsideEvents
from minerva_bus.regions.partition import ById
from minerva_bus.regions.whole import WholeSource
from minerva_bus.wire.limits import Limits
from minerva_bus.world.agent import Agent
from minerva_bus.world.kinds import kinds_of

eRing = EventType("eRing", n=int)
eHeard = EventType("eHeard")
RINGS = 3


class Guest(Agent, symbol="AGuest"):
    rings: int = 0

    @on("eRing")
    def hear(self, ring, moment):
        self.rings = self.rings * 10 + ring.n
        if ring.n == RINGS:
            moment.emit(eHeard())


class Bell(Generator, events=("eRing",), lockstep=False):
    def run(self, emit, stop):
        for number in range(1, RINGS + 1):
            emit(eRing(number))


class Clock(Generator, events=("eRing",)):
    def generate(self, tick):
        return ()


VOCABULARY = Vocabulary.of(eRing, eHeard, Guest)


def world(**more):
    guests = Scene(tuple(Guest(f"g{n}").string.nodes[0] for n in range(7)))
    return World("w", guests, VOCABULARY, until="eHeard", **more)


def test_a_generator_that_runs_freely_reaches_all_regions_once():
    processes = Process("guests", agents=(Guest,)), Process("bell", Bell)
    expected = frozenset(each.name for each in processes)
    file = WorldFile(Path("w.toml"), world(expected=expected), 0.0, processes, partition=ById(3))
    run = RegionRun(file, Console(quiet=True), time.monotonic())
    summary = run.run()
    assert (summary.reached, summary.figures["regions"]) == (True, 3)
    heard = Scene(tuple(Guest(f"g{n}", rings=123).string.nodes[0] for n in range(7)))
    assert summary.digest == VOCABULARY.check(heard).digest.hex()


def test_a_signal_interrupts_regions_after_a_frame_and_code_that_raises_its_exception_fails():
    def run(act):
        class Late(Clock, events=("eRing",)):
            def generate(self, tick):
                if tick.number == 2:
                    act()
                return ()

        processes = Process("guests", agents=(Guest,)), Process("late", Late)
        described = world(expected=frozenset(each.name for each in processes))
        file = WorldFile(Path("w.toml"), described, 0.0, processes, partition=ById(2))
        return RegionRun(file, Console(quiet=True), time.monotonic()).run()

    def fail():
        raise KeyboardInterrupt

    # Each region has the generator, and a second signal would not wait for the end of the frame.
    signals = iter([signal.SIGINT])
    ended = run(lambda: [signal.raise_signal(number) for number in signals])
    assert (ended.ended, ended.frames) == ("interrupted", 3)
    with pytest.raises(WorldStopped, match="late failed in frame 2: code of the world: Keyboard"):
        run(fail)


def whole():
    names, codec = ["region-0", "region-1"], part_codec(VOCABULARY, Limits())
    kinds = kinds_of([Guest])
    source = partial(WholeSource, partition=ById(2), names=names, kinds=kinds, codec=codec)
    return FrameAlgorithm(world(), source)


def answer_to(algorithm, member):
    algorithm.receive(s.Appeared(member.name))
    sent = algorithm.receive(member.hello())
    return [each.message for each in sent if isinstance(each, s.Send)]


def test_only_regions_have_agents_and_generators_in_step():
    algorithm = whole()
    bell = answer_to(algorithm, Member("bell", Bell()))
    assert isinstance(bell[0], m.Welcome)
    for member, what in (
        (Member("clock", Clock()), "runs in step with the frames"),
        (Member("guests", None, [Guest]), "hosts agents"),
    ):
        (refused,) = answer_to(algorithm, member)
        assert isinstance(refused, m.Refused)
        assert what in refused.reason
        assert "--regions 0" in refused.reason


@pytest.mark.parametrize("people", [(), ("eRing",)])
def test_types_that_services_in_regions_make_are_not_for_people(people):
    """The coordinator has no hello of these services."""

    class Pedal(Bell, events=("eRing",), lockstep=False):
        people = True

    class Order(Clock, events=("eHeard",)):
        def takes_orders(self):
            return self.events

    of = {"clock": Clock, "order": Order}
    processes = Process("guests", agents=(Guest,)), *(Process(name, of[name]) for name in of)
    expected = frozenset(each.name for each in processes)
    described = world(expected=expected, people=people)
    with in_regions(
        WorldFile(Path("w.toml"), described, 0.0, processes, partition=ById(2))
    ) as file:
        algorithm = FrameAlgorithm(file.world, source_of(file))
    reason = "eRing comes from clock, so people may not send it" if not people else ""
    assert refusal_of_order(algorithm, "eRing").partition(";")[0] == reason
    (answer,) = answer_to(algorithm, Member("pedal", Pedal()))[:1]
    assert isinstance(answer, m.Welcome if people else m.Refused)
    assert algorithm.members.takers("eHeard") == ["order"]
    assert "order" not in refusal_of_order(algorithm, "eHeard")


def test_services_that_no_frame_waits_for_and_commands_are_outside():
    class Sensor(Bell, events=("eRing",), lockstep=False):
        publishes = ("light",)

    class Lamp(Clock, events=("eRing",)):
        topics = ("light",)

    class Camera(Bell, events=("eRing",), lockstep=False):
        topics = ("sound",)

    processes = [
        Process("guests", agents=(Guest,)),
        Process("bell", Bell),
        Process("sensor", Sensor),
        Process("lamp", Lamp),
        Process("camera", Camera),
        Process("crier", command=("crier",)),
    ]
    services = {each.name: each.participant().service for each in processes}
    file = WorldFile(Path("w.toml"), World("w", Scene(), VOCABULARY), 10.0, tuple(processes))
    assert outside_of(file, services) == {"bell", "camera", "crier"}


def inbox(limit=100, **events):
    made = FrameInbox(Checkpoint(), Scene())
    made.max_single_events = limit
    made.replace({name: list(map(eRing, numbers)) for name, numbers in events.items()})
    return made


def numbers(events):
    return {name: [event.data["n"] for event in sent] for name, sent in events.items()}


def test_events_beyond_the_limit_of_a_frame_wait():
    waiting = inbox(2, bell=(1, 2, 3))
    outside = OutsideEvents(waiting, succeeds=False)
    assert numbers(outside.take(0)) == {"bell": [1, 2]}
    waiting.add("bell", [eRing(4)])
    assert numbers(outside.take(0)) == {"bell": [3, 4]}


def test_a_successor_repeats_a_frame_with_the_events_that_regions_may_have():
    waiting = inbox(bell=(1,))
    waiting.add_order(eRing(5), "anna")
    first = OutsideEvents(waiting, succeeds=False)
    fixed = numbers(first.take(0))
    assert fixed == {"bell": [1], "~order:anna": [5]}
    waiting.add("bell", [eRing(2)])
    later = inbox()
    second = OutsideEvents(later, succeeds=True)
    second.resume(first.noted(in_frame=True))
    # Its own successor, too, if it dies before the frame begins.
    again = OutsideEvents(inbox(), succeeds=True)
    again.resume(second.noted(in_frame=False))
    for outside in (second, again):
        assert numbers(outside.take(0)) == fixed
    later.add("bell", [eRing(3)])
    assert numbers(second.take(1)) == {"bell": [2, 3]}
