"""Table 2: the engine executes the system algorithm frame by frame, as in the paper.

The engine is `FrameAlgorithm` with real hosts, generators and a device; the paper is
`tests/paper/transcription.py`. Both receive the same generators and agents. The tests compare the
variables of Table 2: t, e*, w, and the operations of φ on the device's geometric system.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import hypothesis.strategies as st
import pytest
from hypothesis import HealthCheck, given, settings

from minerva_bus import (
    EMPTY,
    Agent,
    Device,
    EventType,
    Generator,
    Metres,
    Policy,
    Primitive,
    Transformation,
    Vocabulary,
    on,
    view,
)
from minerva_bus.errors import VocabularyError
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.member_side import Member
from minerva_bus.frame.messages import EvolveRequest
from minerva_bus.frame.stimuli import Begin, Ended, FrameDone
from minerva_bus.frame.world_state import WorldSpec
from minerva_bus.grammar.condition import holds
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.scene import Scene, agents, scene_of
from minerva_bus.runtime.runner import InProcessRunner
from minerva_bus.semantics.geometry import Geometry, interpret
from minerva_bus.world.agent import kinds_of
from minerva_bus.world.context import Context, Frame
from minerva_bus.world.event_collection import Priority
from tests.family import FAMILY, FAMILY_VOCABULARY, family_events, family_strings
from tests.paper import transcription

Script = dict[str, Callable[[int], list[Event]]]
"""Generators by name: C(t), the events of each at t."""


@dataclass
class Run:
    """The variables of Table 2, frame by frame."""

    strings: list[Scene] = field(default_factory=list)
    asked: list[tuple[str, int]] = field(default_factory=list)
    events: list[list[Event]] = field(default_factory=list)
    parted: list[tuple[int, list[Event], list[Event]]] = field(default_factory=list)
    drawn: list[tuple[int, list]] = field(default_factory=list)
    ended: str = ""


class Log(Geometry):
    """A geometric system that logs the operations of φ."""

    def __init__(self):
        self.calls = []

    def draw(self, figure):
        self.calls.append(("α", figure.symbol, figure.values))

    def enter(self, transformation):
        self.calls.append(("β", transformation.symbol, transformation.values))

    def leave(self, transformation):
        self.calls.append(("δ", transformation.symbol, transformation.values))


# --- the engine ---


class Scripted(Generator):
    def __init__(self, name, made, vocabulary, run):
        self.name, self.made, self.run_ = name, made, run
        self.events = tuple(vocabulary.events)

    def generate(self, tick):
        self.run_.asked.append((self.name, tick.number))
        return self.made(tick.number)


class Host(Member):
    """A host that logs the events it receives for evolution and for views."""

    def __init__(self, name, kinds, run):
        super().__init__(name, None, kinds)
        self.run = run

    def receive(self, message):
        if isinstance(message, EvolveRequest) and self.name in message.asked:
            parted = message.frame, list(message.events), list(message.visual)
            if parted not in self.run.parted:
                self.run.parted.append(parted)
        return super().receive(message)


class Screen(Device):
    """A device with a geometric system that draws the views of a visual event type."""

    def __init__(self, run, *draws):
        self.draws, self.run_ = draws, run

    def show(self, view):
        log = Log()
        interpret(view.scene, log)
        self.run_.drawn.append((view.frame, log.calls))


@dataclass
class Setting:
    """A world: w₀, its generators and agents; `hosts` is the number of hosts for the agents."""

    w0: Scene
    script: Script
    kinds: tuple[type[Agent], ...]
    vocabulary: Vocabulary
    order: tuple[str, ...]
    visual: str
    policy: Policy = Policy.SEQUENTIAL
    hosts: int = 1
    most: int = 8

    def engine(self) -> Run:
        """Run the world's frames with `FrameAlgorithm`."""
        run = Run()
        members = [
            Member(name, Scripted(name, made, self.vocabulary, run))
            for name, made in self.script.items()
        ]
        members += [Host(f"host{n}", self.kinds, run) for n in range(self.hosts)]
        members.append(Member("screen", Screen(run, self.visual)))
        named = frozenset(member.name for member in members)
        world = WorldSpec(
            "w", self.w0, self.vocabulary, order=Priority(self.order), policy=self.policy,
            expected=named, frames=self.most,
        )  # fmt: skip
        algorithm = FrameAlgorithm(world)
        runner = InProcessRunner(algorithm, members, partial(self._watch, run))
        runner.start()
        while runner.ended is None:
            run.strings.append(algorithm.scene)
            runner.handle(Begin())
            assert len(run.strings) <= self.most
        return run

    def _watch(self, run, instruction):
        if isinstance(instruction, FrameDone):
            assert instruction.frame == len(run.events)
            run.events.append(list(instruction.events))
        elif isinstance(instruction, Ended):
            run.ended = instruction.reason

    def paper(self) -> Run:
        """Run the world's frames as specified in Table 2."""
        run, lam = Run(), Lambda(kinds_of(self.kinds))
        types = sorted(
            self.vocabulary.events,
            key=lambda event: (self.order.index(event) if event in self.order else 99, event),
        )
        sources = {"#agents": lam.emitted, **self.script}
        generators = [
            lambda t, made=sources[name], event_type=event_type: [
                event for event in made(t) if event.type == event_type
            ]
            for event_type in types
            for name in sorted(sources)
        ]
        etas = {Policy.SEQUENTIAL: transcription.eta_sequential, Policy.LITERAL: transcription.eta}

        def phi(v):
            log = Log()
            transcription.phi(v, log.draw, log.enter, log.leave)
            run.drawn.append((len(run.strings) - 1, log.calls))

        frames = transcription.system(
            self.w0, generators, self._is_visual, lam, lam.theta, phi, etas[self.policy]
        )
        for t, w in enumerate(frames):
            if t == self.most:
                run.ended = "the frames are over"
                break
            lam.begin(t, w)
            run.events.append(list(transcription.collect(generators, t)))
            run.strings.append(w)
        else:
            run.ended = "the string is empty"
        return run

    def _is_visual(self, event):
        return self.vocabulary.events[event.type].visual

    def check(self) -> Run:
        """Run both and compare them."""
        engine, paper = self.engine(), self.paper()
        assert engine.ended == paper.ended
        assert engine.strings == paper.strings
        assert engine.events == paper.events
        seen = [t for t, events in enumerate(paper.events) if any(map(self._is_visual, events))]
        assert engine.drawn == [(t, calls) for t, calls in paper.drawn if t in seen]
        asked = [t for t, _, _ in engine.parted]
        assert engine.parted == [
            (
                t,
                [e for e in all_ if not self._is_visual(e)],
                [e for e in all_ if self._is_visual(e)],
            )
            for t, all_ in enumerate(paper.events)
            if t in asked
        ]
        assert engine.asked == [
            (name, t) for t in range(len(paper.strings)) for name in sorted(self.script)
        ]
        return engine


class Lambda:
    """λ and θ as in the paper, with the agents' own classes and without the engine.

    It is also the generator of the agents' events: those sent in the previous frame, in the order of
    the string.
    """

    def __init__(self, kinds):
        self.kinds = kinds
        self.t = 0
        self.w = EMPTY
        self.moments = {}
        self.sent = []

    def begin(self, t, w):
        """Start frame t with w and with the events sent in the previous frame."""
        self.sent = [
            event
            for agent in agents(self.w)
            if agent.id in self.moments
            for event in self.moments[agent.id].emitted
        ]
        self.t, self.w, self.moments = t, w, {}

    def emitted(self, t):
        assert t == self.t
        return self.sent

    def __call__(self, agent, event):
        cls = self.kinds[agent.symbol]
        if not concerns(event, agent, cls.activities):
            return scene_of(agent)
        thawed = cls.thaw(agent)
        moment = self.moments.setdefault(agent.id, Context(Frame(self.t), f"#{agent.id}"))
        result = cls.activities[event.type](thawed, event, moment)
        return thawed.string if result is None else result

    def theta(self, agent, event):
        cls = self.kinds[agent.symbol]
        if not concerns(event, agent, cls.views):
            return EMPTY
        return cls.views[event.type](cls.thaw(agent), event)


def concerns(event, agent, event_types):
    return (
        event.type in event_types
        and (not event.receivers or agent.id in event.receivers)
        and holds(event.condition, agent.state)
    )


# --- a small world, step by step ---

PFox = Primitive("PFox", x=Metres)
TSeen = Transformation("TSeen")
eStep, eHop = EventType("eStep", by=float), EventType("eHop")
eDie, eCall = EventType("eDie"), EventType("eCall")
eDraw = EventType("eDraw", visual=True)


class Fox(Agent, symbol="AFox"):
    x: Metres = 0.0
    heard: int = 0

    @on("eStep")
    def step(self, step, moment):
        self.x += step.by
        if self.x == 12.0:
            moment.emit(eCall())

    @on("eHop")
    def hop(self, event, moment):
        self.x *= 2

    @on("eCall")
    def hear(self, call, moment):
        self.heard += 1

    @on("eDie")
    def die(self, event, moment):
        return EMPTY

    @view("eDraw")
    def picture(self, event):
        return TSeen()(PFox(self.x))


FOXES = Vocabulary.of(PFox, TSeen, eStep, eHop, eDie, eCall, eDraw, Fox)
SCRIPT: Script = {
    "gStep": lambda t: [eStep(1)],
    "gMore": lambda t: [eStep(1), eHop()] if t == 2 else [eStep(1)],
    "gDie": lambda t: [eDie(receivers=["a"])] if t == 3 else [eDie()] if t == 4 else [],
    "gDraw": lambda t: [] if t == 1 else [eDraw()],
}


def foxes(text="PFox<x=-1> · AFox#a · AFox#b<x=10>", script=SCRIPT, **rest):
    return Setting(
        FOXES.read(text), script, (Fox,), FOXES, ("eStep", "eHop"), "eDraw", **{"most": 6, **rest}
    )


@pytest.mark.parametrize("hosts", [1, 3])
def test_every_frame_is_that_of_the_paper(hosts):
    run = foxes(hosts=hosts).check()
    assert [str(w).partition(" · ")[2] for w in run.strings] == [
        "AFox#a<x=0, heard=0>() · AFox#b<x=10, heard=0>()",
        "AFox#a<x=1, heard=0>() · AFox#b<x=11, heard=0>()",
        "AFox#a<x=2, heard=0>() · AFox#b<x=12, heard=0>()",
        "AFox#a<x=6, heard=1>() · AFox#b<x=26, heard=1>()",
        "AFox#b<x=27, heard=1>()",
        "",
    ]


def test_step_1_begins_with_w0_at_t_0():
    run = foxes().check()
    assert run.strings[0] == foxes().w0
    assert run.asked[0][1] == 0
    assert run.drawn[0][0] == 0


def test_step_2_asks_every_generator_in_every_frame_and_takes_each_event_once():
    run = foxes().check()
    assert {name for name, t in run.asked if t == 5} == set(SCRIPT)
    assert [str(event) for event in run.events[2]] == [
        "eStep<by=1>", "eHop", "eCall from #b", "eDraw",
    ]  # fmt: skip


def test_steps_3_and_4_part_the_events_of_views_from_those_of_evolution():
    """A frame with views only changes nothing, and a frame without views draws nothing."""
    run = foxes(script={"gDraw": SCRIPT["gDraw"]}, most=3).check()
    assert run.strings == [foxes().w0] * 3
    assert [t for t, _ in run.drawn] == [0, 2]


def test_step_5_evolves_by_the_events_in_their_order():
    run = foxes(most=4).check()
    assert str(run.strings[3]).endswith("AFox#b<x=26, heard=1>()")  # (12 + 1) * 2, not 12 * 2 + 1


def test_steps_6_and_7_draw_the_string_that_the_frame_began_with():
    run = foxes(most=1).check()
    assert run.drawn == [
        (0, [
            ("α", "PFox", (-1.0,)),
            ("β", "TSeen", ()), ("α", "PFox", (0.0,)), ("δ", "TSeen", ()),
            ("β", "TSeen", ()), ("α", "PFox", (10.0,)), ("δ", "TSeen", ()),
        ]),
    ]  # fmt: skip


def test_steps_8_to_11_go_on_until_the_string_is_empty():
    run = foxes("AFox#a · AFox#b<x=10>").check()
    assert len(run.strings) == 5
    assert run.ended == "the string is empty"


def test_the_empty_world_is_run_once():
    """Step 9 is at the end of the loop: even w_0 = ε has one frame."""
    run = foxes("").check()
    assert run.strings == [EMPTY]
    assert run.ended == "the string is empty"


# --- any world ---


def sound(event):
    """The event, without its condition if agents of this world cannot evaluate it."""
    try:
        return FAMILY_VOCABULARY.check_event(event)
    except VocabularyError:
        return Event(event.type, event.names, event.values, "", event.sender, event.receivers)


@st.composite
def families(draw):
    """A string of the family, and the events of three generators for a few frames."""
    w0 = draw(family_strings())
    plain = st.lists(family_events(w0), max_size=4)
    seen = family_events(w0, visual=True).map(
        lambda events: [e for e in events if e.type == "eShow"]
    )
    made = [draw(plain), draw(plain), draw(st.lists(seen, max_size=4))]

    def script(frames):
        return lambda t: list(map(sound, frames[t])) if t < len(frames) else []

    order = tuple(draw(st.permutations(["eHit", "eStep", "eGrow", "eTurn"])))
    named = {name: script(frames) for name, frames in zip("abc", made, strict=True)}
    hosts = draw(st.integers(1, 3))
    return Setting(w0, named, FAMILY, FAMILY_VOCABULARY, order, "eShow", hosts=hosts, most=4)


@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
@given(families())
def test_the_engine_is_table_2(setting):
    setting.check()


def test_the_engine_is_table_2_by_the_letter_of_equation_3():
    """The paper's copies share a name and the engine's have ids, so this compares without ids."""
    script: Script = {
        "g": lambda t: [[eStep(1)], [eStep(1), eHop()], [eHop(), eStep(2)], [eStep(1)], []][t],
        "gDraw": SCRIPT["gDraw"],
    }
    text = "PFox<x=-1> · AFox#a(AFox#in<x=3>) · AFox#b<x=2>"
    setting = foxes(text, script, policy=Policy.LITERAL, most=5)
    engine, paper = setting.engine(), setting.paper()
    assert list(map(nameless, engine.strings)) == list(map(nameless, paper.strings))
    assert [len(list(agents(w))) for w in engine.strings] == [3, 3, 8, 24, 24]
    seen = [(t, calls) for t, calls in paper.drawn if t != 1]
    assert engine.drawn == seen


def nameless(w):
    return re.sub(r"#[^<(]*", "", str(w))
