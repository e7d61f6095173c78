"""Reports of a region's former process that arrive after the next one has joined."""

from functools import partial

import pytest

from minerva_bus import Vocabulary
from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.compatibility import PROTOCOL_VERSION
from minerva_bus.frame.description import World
from minerva_bus.frame.inputs import FrameInputs
from minerva_bus.grammar.scene import Scene
from minerva_bus.launch.regions.requests import RegionRequests
from minerva_bus.log.entries import encode_inputs, part_codec
from minerva_bus.regions.journal import JOURNAL, PROCESS, encoded
from minerva_bus.regions.lag import RegionLag
from minerva_bus.regions.merging import Units
from minerva_bus.regions.part import PartSender
from minerva_bus.regions.partition import ById
from minerva_bus.regions.progress import NO_PROGRESS
from minerva_bus.regions.whole import PART, WholeSource
from minerva_bus.wire.codec import encode
from minerva_bus.wire.limits import Limits
from minerva_bus.world.agent import Agent
from minerva_bus.world.kinds import kinds_of


class Guest(Agent, symbol="AGuest"):
    pass


NAMES = ["region-0", "region-1"]
VOCABULARY = Vocabulary.of(Guest)
INPUTS = encode_inputs(FrameInputs(0, (), {}, {}, (), (), {}))


def coordinator(ahead):
    scene = Scene((Guest("g").string.nodes[0],))
    lag = RegionLag(ahead, ById(2), 50) if ahead else None
    world = World("w", scene, VOCABULARY, expected=frozenset(NAMES), lag=lag)
    codec = part_codec(VOCABULARY, Limits())
    kinds = kinds_of([Guest])
    source = partial(
        WholeSource, partition=ById(2), names=NAMES, kinds=kinds, codec=codec, ahead=ahead
    )
    return FrameAlgorithm(world, source)


def welcome(algorithm, name):
    """The saved data with which a new process of a region is welcomed."""
    algorithm.receive(s.Appeared(name))
    sent = algorithm.receive(m.Hello(name, PROTOCOL_VERSION, lockstep=True))
    messages = [each.message for each in sent if isinstance(each, s.Send)]
    return next(each for each in messages if isinstance(each, m.Welcome)).saved


def report(number, process, frame=0):
    """A region without agents that do anything reports a frame, in which something arrived."""
    part = ById(2)
    held = [(0,)] if part.region_of(Guest("g").string.nodes[0]) == number else []
    pieces = (Guest("g").string.nodes[0],) if held else ()
    inputs = INPUTS if number == 0 else b""
    message = PartSender().message(frame, Units(held, pieces), (), NO_PROGRESS, (), inputs)
    entry = encoded(0, f"process {process}".encode())
    saved = {PART: encode(message), JOURNAL: entry, PROCESS: process}
    return m.TickReply(NAMES[number], frame, (), saved)


@pytest.mark.parametrize(("ahead", "frame"), [(0, 0), (1, 0), (1, 1)])
def test_a_report_of_a_former_process_is_late(ahead, frame):
    algorithm = coordinator(ahead)
    first = {name: welcome(algorithm, name)[PROCESS] for name in NAMES}
    algorithm.receive(s.Begin())
    algorithm.receive(s.Vanished("region-1"))
    again = welcome(algorithm, "region-1")
    assert again[PROCESS] != first["region-1"]
    assert JOURNAL not in again
    # It was on its way: the journal that the next process has does not lead to it.
    algorithm.receive(report(1, first["region-1"], frame))
    assert algorithm.awaits("region-1")
    assert algorithm.members.get("region-1").late == 1
    for number, process in enumerate((first["region-0"], again[PROCESS])):
        for due in range(frame + 1):
            algorithm.receive(report(number, process, due))
    assert algorithm.frame == 1
    # A third process continues from what the second one has received.
    algorithm.receive(s.Vanished("region-1"))
    assert welcome(algorithm, "region-1")[JOURNAL] == encoded(0, b"process 2")


def test_a_report_that_is_repeated_is_one_of_the_process_that_repeats_it():
    requests = RegionRequests(0)
    requests.keep(report(1, 1))
    requests.process = 2
    again = requests.report(0)
    assert again is not None
    assert again.saved == {**(report(1, 1).saved or {}), PROCESS: 2}
    assert requests.report(1) is None
