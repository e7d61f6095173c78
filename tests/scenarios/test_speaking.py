"""Events of generators: in whose name, how many may wait, and which of them newborns receive.

Generators send in their own name, or in that of agents that the world file names.
"""

import pytest
from pond import VOCABULARY, Counter, Mother, eAdd, eCroak

from minerva_bus.errors import WorldFileError
from minerva_bus.frame import collection_step as collection
from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.member_side import Member
from minerva_bus.frame.messages import PROTOCOL_VERSION
from minerva_bus.frame.stimuli import Checkpoint
from minerva_bus.frame.world_state import WorldSpec
from minerva_bus.grammar.events import Events, single
from minerva_bus.grammar.ids import Ids
from minerva_bus.launch.world_files import read_world_file
from minerva_bus.log.entries import RecordHeader, decode_header, encode_header
from minerva_bus.world.services import When

MANY = 100


def begun(text="ACounter#a · ACounter#b · AFrog#f", when="freely", past=None, **speaks_for):
    string, rest = VOCABULARY.read(text), {"past": past or Checkpoint(), "speaks_for": speaks_for}
    world = FrameAlgorithm(WorldSpec("w", string, VOCABULARY, **rest))
    world.receive(s.Appeared("rain"))
    hello = m.Hello("rain", PROTOCOL_VERSION, generates=("eAdd", "eCroak"), when=When.read(when))
    world.receive(hello)
    return world


def columns(event, senders):
    return Events(
        event.type, event.names, Events.repeated(event, len(senders)).columns, len(senders),
        senders=Ids.of(senders),
    )  # fmt: skip


def said(out):
    return " ".join(message.text for message in out if isinstance(message, s.Notify))


def happened(world):
    (done,) = [message for message in world.receive(s.Begin()) if isinstance(message, s.FrameDone)]
    return [str(event) for event in single(done.record.events)]


FORGED = {
    "an agent's": (eAdd(1, sender="a"),),
    "behind another one": (eAdd(1), eAdd(2, sender="b")),
    "nobody's": (eAdd(1, sender="nobody"),),
    "a generator's": (eAdd(1, sender="rain"),),
    "in columns": (columns(eAdd(1), ["a", "b"]),),
}


@pytest.mark.parametrize("when", ["freely", "in step"])
@pytest.mark.parametrize("how", FORGED)
def test_a_generator_has_no_agent_as_its_sender(how, when):
    world = begun(when=when)
    if when == "in step":
        world.receive(s.Begin())
        out = world.receive(m.TickReply("rain", 0, FORGED[how]))
    else:
        out = world.receive(m.Emitted("rain", FORGED[how]))
    assert "broke the protocol: it sent eAdd from #" in said(out)
    assert "only for itself; speaks_for under [process.rain] names others" in said(out)
    assert not world.members.get("rain").active


@pytest.mark.parametrize("speaks_for", [("ACounter",), ("#b", "#a"), ("AFrog", "#a", "#b")])
def test_it_sends_for_the_agents_in_the_world_file(speaks_for):
    world = begun(rain=speaks_for)
    events = (eAdd(1, sender="a"), eAdd(2), columns(eAdd(3), ["a", "b"]))
    assert "broke" not in said(world.receive(m.Emitted("rain", events)))
    assert happened(world) == [
        "eAdd<n=1> from #a", "eAdd<n=2>", "eAdd<n=3> from #a", "eAdd<n=3> from #b"
    ]  # fmt: skip


@pytest.mark.parametrize("speaks_for", [("ACounter",), ("#a",), ("#a", "AMother")])
@pytest.mark.parametrize("in_columns", [False, True])
def test_and_for_no_others(speaks_for, in_columns):
    world = begun(rain=speaks_for)
    event = columns(eAdd(1), ["a", "f"]) if in_columns else eAdd(1, sender="f")
    out = world.receive(m.Emitted("rain", (event,)))
    assert f"from #f, but it speaks only for {', '.join(speaks_for)};" in said(out)


def test_permissions_of_another_member_do_not_apply():
    out = begun(rainy=("ACounter",)).receive(m.Emitted("rain", (eAdd(1, sender="a"),)))
    assert "broke the protocol" in said(out)


@pytest.mark.parametrize("in_columns", [False, True])
def test_the_events_of_one_that_is_no_more_are_left_out_and_counted(in_columns):
    """A bridge learns of deaths late; it may not speak for later newborns either."""
    world = begun(rain=("ACounter",))
    events = (eAdd(1, sender="a"), eAdd(1, sender="a:1"))
    if in_columns:
        events = (columns(eAdd(1), ["a", "a:1"]),)
    assert "broke" not in said(world.receive(m.Emitted("rain", events)))
    out = world.receive(s.Begin())
    assert "sent 1 events from agents that are not in the string" in said(out)
    (done,) = [message for message in out if isinstance(message, s.FrameDone)]
    assert [str(event) for events in done.record.events for event in (events if in_columns else [events])] \
        == ["eAdd<n=1> from #a"]  # fmt: skip
    assert world.members.get("rain").dropped == 1


def test_it_speaks_for_agents_in_columns():
    text = " · ".join(f"AFrog#f{n}" for n in range(MANY))
    senders = [f"f{n}" for n in range(MANY)]
    for speaks_for in (("AFrog",), tuple(f"#{sender}" for sender in senders)):
        world = begun(text, rain=speaks_for)
        assert world.composition.parts
        assert "broke" not in said(
            world.receive(m.Emitted("rain", (columns(eCroak(1.0), senders),)))
        )
    world = begun(text, rain=("ACounter",))
    out = world.receive(m.Emitted("rain", (columns(eCroak(1.0), senders),)))
    assert "from #f0, but it speaks only for ACounter" in said(out)


def test_a_record_has_it():
    world = begun(rain=("ACounter",)).world
    read, _ = decode_header(encode_header(RecordHeader(world)))
    assert read.world.speaks_for == {"rain": ("ACounter",)}


FILE = """
[world]
vocabulary = "pond:VOCABULARY"
string = "ACounter#a"
[process.counters]
agents = "pond:Counter"
{agents}
[process.add]
command = ["true"]
processes = 2
{add}
"""


def read(tmp_path, add="", agents=""):
    path = tmp_path / "w.toml"
    path.write_text(FILE.format(add=add, agents=agents))
    return read_world_file(path)


def test_the_world_file_names_them(tmp_path):
    file = read(tmp_path, 'speaks_for = ["ACounter", "#x:1"]')
    assert file.world.speaks_for == dict.fromkeys(("add-1", "add-2"), ("ACounter", "#x:1"))


@pytest.mark.parametrize(
    ("add", "agents", "problem"),
    [
        ('speaks_for = "ACount"', "", r"\[process.add-1\]: .* no agents ACount; did you mean"),
        ('speaks_for = "a"', "", r'no agents a.* \(an id is "#a"\)'),
        ('speaks_for = "#a b"', "", r"'#a b' is not a valid agent id"),
        ("speaks_for = 7", "", "must be a list of texts"),
        ("", 'speaks_for = "ACounter"', "speaks_for is for generators"),
    ],
)
def test_a_world_file_that_names_them_wrongly(tmp_path, add, agents, problem):
    with pytest.raises(WorldFileError, match=problem):
        read(tmp_path, add, agents)


# --- excess events: memory is bounded; dropped events are counted and reported ---


def test_a_paused_world_keeps_so_many_events_and_no_more(monkeypatch):
    monkeypatch.setattr(collection, "MAX_WAITING", 10)
    world = begun()
    texts = [said(world.receive(m.Emitted("rain", (eAdd(number),)))) for number in range(25)]
    full = "event queue full: 10 events wait for a frame; dropping further events"
    assert [text for text in texts if text] == [full]
    assert world.members.get("rain").dropped == 15
    assert happened(world) == [f"eAdd<n={number}>" for number in range(10)]


def test_waiting_events_count_after_succession(monkeypatch):
    monkeypatch.setattr(collection, "MAX_WAITING", 10)
    past = Checkpoint(3, inbox={"rain": tuple(eAdd(number) for number in range(8))})
    world = begun(past=past)
    for number in range(8, 20):
        world.receive(m.Emitted("rain", (eAdd(number),)))
    assert world.members.get("rain").dropped == 10
    assert happened(world) == [f"eAdd<n={number}>" for number in range(10)]


def test_a_newborn_gets_no_event_of_the_frame_of_its_birth_and_all_of_the_next():
    """Section 9 of PROTOCOL.md."""
    world, host = begun("AMother#m"), Member("host", None, [Mother, Counter])

    def tell(stimulus):
        for message in world.receive(stimulus):
            if isinstance(message, s.Send) and message.to in ("host", s.HOSTS, s.EVERYONE):
                for reply in host.receive(message.message):
                    tell(reply)

    tell(s.Appeared("host"))
    early = eAdd(100, receivers=["m:1"])
    tell(m.Emitted("rain", (eAdd(1), eAdd(2), early)))
    tell(s.Begin())
    assert "ACounter#m:1<n=1>" in str(world.scene)
    assert "ACounter#m:2<n=2>" in str(world.scene)
    tell(m.Emitted("rain", (eAdd(10, receivers=["m:1"]),)))
    tell(s.Begin())
    assert "ACounter#m:1<n=11>" in str(world.scene)
