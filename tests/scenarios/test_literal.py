"""Worlds under `policy = "literal"`: equation 3 as written, on one host."""

from dataclasses import replace
from functools import partial
from random import Random

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, note, settings
from pond import VOCABULARY as POND
from pond import Add, Bus, Counter, Lily, Minnow, Mother, Screen, eAdd, eCroak, eShow, service
from pond import eStep as eHop
from test_any_schedule import play

from minerva_bus import Agent, EventType, Generator, Policy, Vocabulary, evolve, on
from minerva_bus.errors import MisuseError, VocabularyError
from minerva_bus.frame import messages as m
from minerva_bus.frame.member_side import Member
from minerva_bus.frame.world_state import WorldSpec
from minerva_bus.grammar.scene import EMPTY, AgentNode, Scene, agents, walk
from minerva_bus.world.context import Frame
from minerva_bus.world.event_collection import Priority, collect
from minerva_bus.world.norms import Norm
from tests.family import FAMILY, FAMILY_VOCABULARY, family_events, family_strings
from tests.one_process import run_world

ORDER = Priority(("eAdd", "eStep", "eHit"))
SEED = 5


class Script(Generator, events=()):
    """Generates the events of a script: a list per frame, none after the last list."""

    def __init__(self, vocabulary, script):
        self.script = script
        self.events = tuple(vocabulary.events)

    def generate(self, tick):
        return self.script[tick.number] if tick.number < len(self.script) else ()


def world(scene, script, hosts, vocabulary=POND, **rest):
    """A literal world that follows a script, and its members; `hosts` have agent classes."""
    members = {"script": lambda: Member("script", Script(vocabulary, script))}
    members |= {name: partial(Member, name, None, kinds) for name, kinds in hosts.items()}
    members |= rest.pop("more", {})
    string = vocabulary.read(scene) if isinstance(scene, str) else scene
    rest = {"frames": len(script), "seed": SEED, "order": ORDER, **rest}
    named = frozenset(members)
    return WorldSpec(
        "w", string, vocabulary, expected=named, policy=Policy.LITERAL, **rest
    ), members


def bus_of(*what, **rest):
    bus = Bus(*world(*what, **rest))
    bus.start()
    return bus


def ran(*what, **rest):
    """A bus whose world has run to its end."""
    bus = bus_of(*what, **rest)
    bus.run()
    assert bus.ended is not None, (bus.said, bus.algorithm.waiting_for())
    assert bus.said == []
    return bus


def in_one_process(*what, **rest):
    """The digests of a world in one process."""
    described, members = world(*what, **rest)
    members, digests = [make() for make in members.values()], []
    run_world(described, members, lambda done, scene: digests.append(scene.digest.hex()))
    return digests


def ids(scene):
    return [agent.id for agent in agents(scene)]


def copies(scene, events):
    """The number of agents after a frame without births and deaths."""
    depth = count = 0
    for opens, node in walk(scene):
        if isinstance(node, AgentNode):
            depth += 1 if opens else -1
            count += events**depth if opens else 0
    return count


def strings(scene, script, kinds, vocabulary, most=120):
    """w of each frame by `evolve` on the whole string, as long as it stays small."""
    emitted = []
    for frame, made in enumerate(script):
        sources = {"script": made} | ({"#": emitted} if emitted else {})
        events = collect(ORDER, sources)
        events = [event for event in events if not vocabulary.events[event.type].visual]
        if copies(scene, len(events)) > most:
            return
        evolved = evolve(scene, events, kinds, Frame(frame, 0.1, SEED), Policy.LITERAL)
        emitted = [event for id in ids(scene) for event in evolved.emitted.get(id, ())]
        scene = evolved.scene
        yield scene


# --- the layout ---

eTick, eOther = EventType("eTick"), EventType("eOther")


class Yes(Agent, symbol="AY"):
    n: int = 0

    @on("eTick")
    def tick(self, event, moment):
        self.n += 1


class No(Agent, symbol="AN"):
    """Responds to nothing: no event ever concerns its host."""


TWO = Vocabulary.of(eTick, eOther, Yes, No)


def test_two_events_in_each_of_two_frames():
    """Every agent is copied for every event of a frame, whatever its handlers."""
    script, hosts = [[eTick(), eOther()]] * 2, {"host": (Yes, No)}
    bus = ran("AY#y · AN#n", script, hosts, vocabulary=TWO)
    assert str(bus.algorithm.scene) == (
        "AY#y<n=0>() · AY#y:1-2<n=1>() · AY#y:0-2<n=1>() · AY#y:0-2:1-2<n=2>()"
        " · AN#n() · AN#n:1-2() · AN#n:0-2() · AN#n:0-2:1-2()"
    )
    assert bus.digests == in_one_process("AY#y · AN#n", script, hosts, vocabulary=TWO)


def sound(event):
    """The event; without its condition if agents of this world cannot satisfy that."""
    try:
        return FAMILY_VOCABULARY.check_event(event)
    except VocabularyError:
        return replace(event, condition="")


@st.composite
def cases(draw):
    """A string of the family, and the events of a few frames for it and its first copies."""
    scene = draw(family_strings())
    assume(0 < len(ids(scene)) <= 6)
    frames = st.lists(family_events(scene), max_size=3)
    return scene, [list(map(sound, events[:3])) for events in draw(frames)]


@settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))
@given(cases(), st.integers(0, 1 << 32))
def test_a_world_is_evolve_on_the_whole_string(case, seed):
    """This holds in every frame, for any schedule, and in one process."""
    scene, script = case
    wanted = list(strings(scene, script, FAMILY, FAMILY_VOCABULARY))
    script = script[: len(wanted)]
    assume(script)
    what = (scene, script, {"host": FAMILY}, FAMILY_VOCABULARY)
    bus = bus_of(*what)
    play(bus, Random(seed), [])
    note("\n".join(bus.trace))
    digests = [scene.digest.hex() for scene in wanted]
    if EMPTY in wanted:
        digests = digests[: wanted.index(EMPTY) + 1]
    assert bus.digests == digests
    assert in_one_process(*what) == digests
    for string in wanted:
        assert len(ids(string)) == len(set(ids(string)))


MANY = Minnow.many("m", 70, x=np.arange(70.0)) + POND.read("ALily#l(AMinnow#x · AMother#o)")
SCHOOL = (Minnow, Lily, Mother, Counter)


@pytest.mark.parametrize("columns", [True, False])
def test_agents_in_columns_are_agents(columns):
    script = [[eHop(1), eAdd(2)], [eHop(2)], [eCroak(0.5), eAdd(1)]]
    scene = MANY if columns else Scene(MANY.nodes)
    bus = ran(scene, script[:2], {"host": SCHOOL}, frames=2)
    wanted = list(strings(Scene(MANY.nodes), script[:2], SCHOOL, POND, most=1 << 20))
    assert bus.digests == [scene.digest.hex() for scene in wanted]
    assert len(ids(wanted[0])) > 2 * 70


# --- no events ---


def test_without_events_no_agent_is_left():
    bus = ran("AY#y(AN#in) · AN#n", [[], [eTick()]], {"host": (Yes, No)}, vocabulary=TWO)
    assert len(bus.records) == 1
    assert bus.ended.reason == "the string is empty"


def test_without_events_figures_stay_and_so_do_agents_without_a_host():
    scene = "PDot<x=1> · TAt<x=2>(ACounter#a · PDot<x=3>) · ALily#l(ACounter#b)"
    bus = bus_of(scene, [[], []], {"host": (Counter,)})
    bus.run()
    assert str(bus.algorithm.scene) == (
        "PDot<x=1> · TAt<x=2>(PDot<x=3>) · ALily#l<steps=0>(ACounter#b<n=0>())"
    )


def test_a_view_is_no_event_of_evolution():
    """e^v goes to π alone: a frame with only a visual event shows its agents and leaves none."""
    eye = Screen()
    bus = ran(
        "ACounter#a", [[eShow()]], {"host": (Counter,)}, more={"eye": service("eye", lambda: eye)}
    )
    assert bus.ended.reason == "the string is empty"
    assert eye.shown[0] == "0: PDot<x=0>"


def test_a_world_in_which_agents_would_vanish_does_not_rest():
    class Bell(Add, when="freely"):
        """Adds when it is triggered."""

    members = {
        "bell": service("bell", Bell),
        "host": partial(Member, "host", None, (Counter,)),
    }
    described = WorldSpec(
        "w",
        POND.read("ACounter#a · PDot<x=0>"),
        POND,
        expected=frozenset(members),
        policy=Policy.LITERAL,
    )
    bus = Bus(described, members)
    bus.do("start, settle")
    assert not bus.algorithm.at_rest
    bus.handle(m.Emitted("bell", (eAdd(1),)))
    bus.frame()
    assert str(bus.algorithm.scene) == "ACounter#a<n=1>() · PDot<x=0>"
    assert not bus.algorithm.at_rest
    bus.frame()
    assert str(bus.algorithm.scene) == "PDot<x=0>"
    bus.frame()
    assert bus.algorithm.at_rest


# --- copies among others ---


class Talker(Agent, symbol="ATalker"):
    """Answers a question to its sender."""

    asked: int = 0
    answered: int = 0

    @on("eGo")
    def ask(self, event, moment):
        self.asked += 1
        moment.emit(eAsk())

    @on("eAsk")
    def answer(self, event, moment):
        moment.emit(eAnswer(receivers=[event.sender]))

    @on("eAnswer")
    def note(self, event, moment):
        self.answered += 1
        moment.emit(eEnd())


eGo, eAsk, eAnswer, eEnd = (EventType(name) for name in ("eGo", "eAsk", "eAnswer", "eEnd"))
TALK = Vocabulary.of(eGo, eAsk, eAnswer, eEnd, eOther, Talker)


def test_copies_send_in_their_own_names_and_are_answered():
    hosts = {"host": (Talker,)}
    script = [[eOther(), eGo(receivers=["t"])], [], []]
    bus = ran(
        "ATalker#t · ATalker#u", script, hosts, vocabulary=TALK, order=Priority(("eOther", "eGo"))
    )
    assert [event.sender for event in bus.records[1].events] == ["t:0-2"]
    heard = {event.receivers for event in bus.records[2].events}
    assert heard == {("t:0-2",)}
    answered = [agent.id for agent in agents(bus.algorithm.scene) if agent.state["answered"]]
    assert {id.split(":2-")[0] for id in answered} == {"t:0-2"}


def test_a_member_may_not_send_in_the_name_of_a_copy_that_is_not():
    bus = bus_of("ATalker#t", [[eGo()], []], {"host": (Talker,)}, vocabulary=TALK)
    bus.do("settle, hold up host, frame, drop up host")
    event = eAsk()
    forged = type(event)(event.type, sender="t:0-2")
    bus.put(m.EvolveReply("host", 0, 0, {}, {"t": (forged,)}, {}))
    bus.do("release, settle")
    assert "it sent events of #t in another's name" in bus.said[0]


def test_every_copy_has_to_send_until():
    script = [[eGo()], [], [], [eOther()]]
    talk = ran("ATalker#t", script, {"h": (Talker,)}, vocabulary=TALK, frames=9, until="eEnd")
    assert talk.ended.reason == "every agent has sent eEnd"
    script = [[eGo(), eOther()]]
    two = ran("ATalker#t", script, {"h": (Talker,)}, vocabulary=TALK, frames=4, until="eEnd")
    assert two.ended.reason == "the frames are over"


def test_ids_of_copies_are_not_those_that_people_write_nor_those_of_newborns():
    text = "AMother#y · AMother#y-2 · AMother#y:1:5 · ACounter#y:2-2 · ACounter#y_0-2"
    with pytest.raises(VocabularyError, match=r"world w: ACounter#y:2-2 has the id of a copy that"):
        world(text, [[eAdd(1)]], {"host": (Mother, Counter)})
    script = [[eAdd(1), eAdd(2)]] * 3
    bus = ran(text.replace("y:2-2", "y-2-2"), script, {"host": (Mother, Counter)})
    names = ids(bus.algorithm.scene)
    assert len(names) == len(set(names)) > 100


def test_ids_of_copies_of_copies_stay_short():
    """Each frame copies the second copy and removes the first, so names nest indefinitely."""
    script = [[eAdd(100), eHop(1)]] * 60
    bus = ran("ACounter#a", script, {"host": (Counter,)})
    (name,) = ids(bus.algorithm.scene)
    assert len(name) <= 64


def test_a_world_goes_on_from_its_own_copies():
    script = [[eAdd(1), eAdd(2)], [eAdd(3), eAdd(4)], [eAdd(5)], [eAdd(6), eAdd(7)]]
    hosts = {"host": (Mother, Counter)}
    whole = ran("AMother#a · ACounter#b", script, hosts)
    bus = bus_of("AMother#a · ACounter#b", script, hosts)
    bus.run(2)
    past = bus.algorithm.checkpoint
    again = ran(bus.algorithm.scene, script, hosts, past=past)
    assert again.digests == whole.digests[2:]


def test_the_coordinator_is_killed_at_any_step():
    script = [[eAdd(1), eAdd(2)], [eAdd(3)], [eAdd(4), eAdd(5)], []]
    what = ("AMother#a · TAt<x=1>(ACounter#b) · PDot<x=0>", script, {"host": (Mother, Counter)})
    whole = ran(*what).digests

    def killed(after):
        bus = bus_of(*what)
        steps = 0
        while bus.ended is None and (links := bus.ready()):
            bus.step(next((link for link in links if link != ("begin", "")), links[0]))
            steps += 1
            if steps == after and len(bus.records) < len(whole):
                bus.kill_coordinator()
        return bus.digests, steps

    _, steps = killed(0)
    for after in range(1, steps):
        assert killed(after)[0] == whole, f"killed after step {after}"


def test_a_host_that_dies_and_returns_changes_nothing():
    script = [[eAdd(1), eAdd(2)], [eAdd(3)], [eAdd(4), eAdd(5)]]
    hosts = {"host": (Mother, Counter)}
    whole = ran("AMother#a · ACounter#b · ACounter#c", script, hosts).digests
    for after in range(3, 60, 4):
        bus = bus_of("AMother#a · ACounter#b · ACounter#c", script, hosts)
        for now in range(200):
            if now == after and "host" in bus.alive:
                bus.restart("host")
            links = bus.ready()
            if not links:
                break
            bus.step(next((link for link in links if link != ("begin", "")), links[0]))
        assert bus.digests == whole


def test_too_many_copies_are_refused_before_they_are_made():
    nested = POND.read("ALily#a(ALily#b(ALily#c(ALily#d(ACounter#e))))")
    events = [eAdd(n) for n in range(20)]
    with pytest.raises(
        MisuseError, match=r"makes 20 copies of each agent in frame 3, .* copies; use fewer"
    ):
        evolve(nested, events, (Lily, Counter), Frame(3), Policy.LITERAL)


def test_a_norm_refuses_all_copies_that_a_frame_makes_of_an_agent():
    """One copy that violates the norm suffices: the agent keeps its state and stays single."""
    norm = Norm("few", ("ACounter",), where="n > 4")
    script = [[eAdd(1), eAdd(2)], [eAdd(3)]]
    text = "ACounter#a · ACounter#b<n=3> · ALily#l(ACounter#c<n=9>)"
    bus = ran_with(norm, text, script, {"host": SCHOOL})
    assert str(bus.algorithm.scene).startswith(
        "ACounter#a<n=4>() · ACounter#a:0-2<n=2>() · ACounter#b<n=3>() · ALily#l<"
    )


def ran_with(norm, *what):
    """Like `ran`, with a norm; checks that only rejections are reported."""
    bus = bus_of(*what, norms=(norm,))
    bus.run()
    assert bus.ended is not None
    assert all("few is broken" in line for line in bus.said)
    return bus


# --- a second host ---

ONE_HOST = (
    'policy = "literal" evolves all agents on one host, which is host: give it all classes of'
    " agents"
)


def guest():
    return Member("guest", None, (Counter,))


def test_a_second_host_is_refused_as_long_as_there_is_one():
    bus = bus_of("ACounter#a", [[eAdd(1)]] * 4, {"host": (Counter,)})
    bus.run(1)
    bus.join("guest", guest)
    bus.run(1)
    assert bus.said[0] == f"guest: may not join: {ONE_HOST}"
    assert bus.algorithm.members.offers().keys() == {"host"}


def test_a_world_with_two_hosts_does_not_begin():
    bus = bus_of("ACounter#a", [[eAdd(1)]], {"host": (Counter,), "other": (Counter,)})
    bus.run()
    assert bus.algorithm.failed
    assert ONE_HOST in bus.ended.reason


def test_a_guest_that_is_faster_than_the_own_host_gives_way():
    bus = Bus(*world("ACounter#a", [[eAdd(1)]], {"host": (Counter,)}))
    own = list(bus.makers)
    bus.join("guest", guest)
    bus.settle()
    assert bus.algorithm.members.offers().keys() == {"guest"}
    for name in own:
        bus.appear(name)
    bus.run()
    one_host, _, _ = ONE_HOST.partition(":")
    assert bus.said[0] == f"guest: may not take part: {one_host} of the world file"
    assert [record.events for record in bus.records] == [(eAdd(1),)]
    assert not bus.algorithm.failed
