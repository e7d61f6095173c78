"""Excess events: memory is bounded; dropped events are counted and reported."""

from minerva_bus.frame import inbox as a
from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.checkpoint import Checkpoint
from minerva_bus.frame.compatibility import PROTOCOL_VERSION
from minerva_bus.frame.description import World
from minerva_bus.grammar.symbols import EventType, Primitive
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.world.when import Participation, When

FREELY = When(Participation.FREELY)

PStone = Primitive("PStone")
eDrop = EventType("eDrop", number=int)


def test_a_paused_world_keeps_so_many_events_and_no_more(monkeypatch):
    monkeypatch.setattr(a, "MAX_WAITING", 10)
    world = FrameAlgorithm(World("w", PStone(), Vocabulary.of(PStone, eDrop)))
    world.receive(s.Appeared("rain"))
    world.receive(m.Hello("rain", PROTOCOL_VERSION, generates=("eDrop",), when=FREELY))
    said = []
    for number in range(25):
        out = world.receive(m.Emitted("rain", (eDrop(number),)))
        said += [message.text for message in out if isinstance(message, s.Notify)]
    assert said == ["event queue full: 10 events wait for a frame; dropping further events"]
    assert world.members.get("rain").dropped == 15
    done = [message for message in world.receive(s.Begin()) if isinstance(message, s.FrameDone)]
    assert [event.number for event in done[0].record.events] == list(range(10))


def test_waiting_events_count_after_succession(monkeypatch):
    monkeypatch.setattr(a, "MAX_WAITING", 10)
    past = Checkpoint(3, inbox={"rain": tuple(eDrop(number) for number in range(8))})
    world = FrameAlgorithm(World("w", PStone(), Vocabulary.of(PStone, eDrop), past=past))
    world.receive(s.Appeared("rain"))
    world.receive(m.Hello("rain", PROTOCOL_VERSION, generates=("eDrop",), when=FREELY))
    for number in range(8, 20):
        world.receive(m.Emitted("rain", (eDrop(number),)))
    assert world.members.get("rain").dropped == 10
    done = [message for message in world.receive(s.Begin()) if isinstance(message, s.FrameDone)]
    assert [event.number for event in done[0].record.events] == list(range(10))
