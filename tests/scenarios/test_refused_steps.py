"""Rejected steps are not executed by bodies; earlier events of the frame still count."""

from dataclasses import replace

import numpy as np
import pytest
from pond import Bus, host, service

from minerva_bus import (
    EMPTY,
    Agent,
    Device,
    EventType,
    Generator,
    Primitive,
    Scene,
    Tick,
    View,
    Vocabulary,
    on,
    view,
)
from minerva_bus.errors import MisuseError
from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.world_state import WorldSpec
from minerva_bus.grammar.columns import Delta
from minerva_bus.grammar.ids import LONGEST
from minerva_bus.grammar.scene import FigureNode, agents, walk
from minerva_bus.world.event_collection import Priority
from minerva_bus.world.norms import Norm, rested

PPush = Primitive("PPush", who=str, push=float)
eWord, eStep, eAfter = EventType("eWord"), EventType("eStep"), EventType("eAfter")
eFine = EventType("eFine", amount=int)
eRefused = EventType("eRefused", norm=str)
eShow = EventType("eShow", visual=True)


class State(Agent):
    x: float = 0.0
    push: float = 0.0
    words: int = 0
    after: int = 0
    fined: int = 0
    refused: int = 0

    @on("eWord", population=True)
    def hear(self, word, moment):
        self.words += 1

    @on("eAfter", population=True)
    def late(self, after, moment):
        self.after += 1

    @on("eFine", population=True)
    def pay(self, fine, moment):
        self.fined += fine.amount

    @on("eRefused", population=True)
    def note(self, refused, moment):
        self.refused += 1

    @on("eStep", population=True)
    def step(self, step, moment):
        self.x = self.x + self.push
        self.push = self.x * 0 + 1.0

    @view("eShow")
    def show(self, event):
        return PPush(self.id, self.push)


class Cart(State, symbol="ACart", rest=("push",)):
    """Executes in each frame the push that it chose in the previous one."""


class Walker(State, symbol="AWalker"):
    """The same, without a rest attribute."""


class Moth(State, symbol="AMoth"):
    """Dies in each step and leaves one of its children."""

    births: int = 0

    @on("eStep")
    def step(self, step, moment):
        children = [self.child(x=self.x + 1.0) for _ in range(3)]
        return children[1]


class Spore(State, symbol="ASpore"):
    """The same, for a whole population at once."""

    births: int = 0

    @on("eStep", population=True)
    def step(self, step, moment):
        self.bear(x=self.x + 1.0)
        self.bear(self.x == 2.0, x=self.x - 1.0)
        self.die()


class Train(Agent, symbol="ATrain"):
    """An agent that contains carts."""


class Clock(Generator, events=("eWord", "eStep", "eAfter", "eShow")):
    def generate(self, tick: Tick):
        return [eWord(), eStep(), eAfter(), eShow()]


class Motor(Device, Generator, draws=("eShow",), coupled=True, events=()):
    """Pushes bodies as views specify."""

    def __init__(self):
        self.bodies, self.push = {}, {}

    def show(self, view: View) -> None:
        figures = [n for opens, n in walk(view.scene) if opens and isinstance(n, FigureNode)]
        shown = {node.parameters["who"]: node.parameters["push"] for node in figures}
        self.push = {who: 0.0 if who in view.halted else push for who, push in shown.items()}

    def generate(self, tick: Tick):
        for who, push in self.push.items():
            self.bodies[who] = self.bodies.get(who, 0.0) + push
        self.push = {}
        return ()

    def save(self):
        return {"bodies": dict(self.bodies)}

    def restore(self, saved):
        self.bodies = dict(saved["bodies"])


KINDS = (Cart, Walker, Moth, Spore, Train)
VOCABULARY = Vocabulary.of(PPush, eWord, eStep, eAfter, eFine, eRefused, eShow, *KINDS)
WALL = Norm("wall", when="x > 3", sanction=eFine(5))
ORDER = Priority(("eWord", "eStep", "eAfter", "eFine"))


def world(text, norms=(WALL,), hosts=1, **rest):
    members = {f"host-{n}": host(f"host-{n}", *KINDS) for n in range(hosts)}
    motor = Motor()
    members |= {"clock": service("clock", Clock), "motor": service("motor", lambda: motor)}
    w = VOCABULARY.read(text) if isinstance(text, str) else text
    rest = {"order": ORDER, "frames": 14, **rest}
    made = WorldSpec("carts", w, VOCABULARY, expected=frozenset(members), norms=norms, **rest)
    bus = Bus(made, members)
    bus.motor = motor
    return bus


def states(bus):
    return {agent.id: agent.state for agent in agents(bus.algorithm.scene) if "x" in agent.state}


def together(bus, frames):
    """Run frame by frame; check that bodies are where agents were when the frame began."""
    bus.do("start, settle")
    first = {who: state["x"] for who, state in states(bus).items()}
    for number in range(frames):
        before = {who: state["x"] - first[who] for who, state in states(bus).items()}
        bus.frame()
        bodies = bus.motor.bodies
        assert all(bodies[who] == before[who] for who in bodies), number
    return states(bus)


@pytest.mark.parametrize("symbol", ["ACart", "AWalker"])
def test_body_and_string_stay_together_with_and_without_rest(symbol):
    bus = world(f"{symbol}#a")
    end = together(bus, 13)["a"]
    assert end["x"] == 3.0
    assert bus.motor.bodies == {"a": 3.0}


def test_a_rejected_agent_is_at_rest_and_may_choose_again():
    bus = world("ACart#a")
    pushes, refused = [], []
    bus.start()
    for _ in range(9):
        bus.run(1)
        pushes.append(states(bus)["a"]["push"])
        refused.append(bus.algorithm.norms.broken.get("wall", 0))
    assert refused == [0, 0, 0, 0, 1, 1, 2, 2, 3]
    assert pushes == [1.0, 1.0, 1.0, 1.0, 0.0, 1.0, 0.0, 1.0, 0.0]


@pytest.mark.parametrize("symbol", ["ACart", "AWalker"])
def test_events_before_the_step_count_and_sanctions_always_do(symbol):
    bus = world(f"{symbol}#a")
    end = together(bus, 14)["a"]
    refused = bus.algorithm.norms.broken["wall"]
    assert refused >= 5
    assert end["words"] == 14, "eWord comes before eStep"
    assert end["after"] == 14 - refused, "eAfter follows it"
    assert end["fined"] == 5 * (refused - 1) or end["fined"] == 5 * refused
    assert end["refused"] * 5 == end["fined"]


def test_a_fine_reaches_an_agent_whose_changes_are_all_rejected():
    """Its initial state is forbidden already, so every step is rejected."""
    bus = world("AWalker#a<x=9>", (replace(WALL, name="all"),))
    end = together(bus, 14)["a"]
    assert bus.algorithm.norms.broken == {"all": 14}
    assert (end["fined"], end["refused"], end["words"], end["x"]) == (65, 13, 0, 9.0)


def test_a_sanction_that_is_forbidden_itself_does_not_count():
    poor = Norm("poor", when="fined > 7")
    bus = world("AWalker#a", (WALL, poor))
    assert together(bus, 14)["a"]["fined"] == 5


def run(bus):
    bus.do("start, run")
    return bus.digests


def crowd(kind, count):
    return kind.many("c", count, x=np.arange(count) % 7 * 0.5)


@pytest.mark.parametrize("kind", [Cart, Walker])
def test_many_are_as_those_one_by_one_on_any_number_of_hosts(kind):
    columns = crowd(kind, 100)
    alone = run(world(columns))
    assert len(set(alone)) == 14
    for hosts in (1, 2, 3):
        assert run(world(Scene(columns.nodes), hosts=hosts)) == alone
        assert hosts == 1 or run(world(columns, hosts=hosts)) == alone


@pytest.mark.parametrize("kind", [Moth, Spore])
@pytest.mark.parametrize("stem", ["c", "c" * (LONGEST - 4)])
def test_parents_that_die_in_a_rejected_step_are_restored(kind, stem):
    """With a long stem the ids of newborns are hashes, which do not contain the parent's id."""
    columns = kind.many(stem, 100, x=np.arange(100) % 7 * 0.5)
    single = []
    for begin in range(0, 100, 10):  # So few agents are separate nodes, not columns.
        few = world(Scene(columns.nodes[begin : begin + 10]), frames=6)
        run(few)
        assert not few.algorithm.composition.parts
        assert few.algorithm.norms.broken["wall"] > 0
        single += few.algorithm.scene.nodes
    for hosts in (1, 3):
        population = world(columns, frames=6, hosts=hosts)
        run(population)
        assert population.algorithm.scene == Scene(tuple(single))


def test_a_train_stands_still_with_all_in_it():
    bus = world("ATrain#t(ACart#a · ACart#b<x=-9>)")
    end = together(bus, 13)
    assert (end["a"]["x"], end["b"]["x"]) == (3.0, -6.0)
    assert end["b"]["words"] == 13


@pytest.mark.parametrize("steps", range(1, 14, 2))
def test_hosts_that_die_within_a_refused_frame_change_nothing(steps):
    calm = run(world("ACart#a · AWalker#b<x=-2>", hosts=2))
    bus = world("ACart#a · AWalker#b<x=-2>", hosts=2).do("start, run 4")
    for _ in range(steps):
        bus.step(bus.ready()[0])
    bus.do("restart host-0, restart host-1, settle, run")
    assert bus.digests == calm
    assert bus.motor.bodies["a"] == 3.0


@pytest.mark.parametrize("steps", range(1, 14, 2))
def test_a_coordinator_that_dies_within_a_refused_frame_changes_nothing(steps):
    calm = run(world("ACart#a · AWalker#b<x=-2>"))
    bus = world("ACart#a · AWalker#b<x=-2>").do("start, run 5")
    for _ in range(steps):
        bus.step(bus.ready()[0])
    bus.do("kill_coordinator, run")
    assert bus.digests[-1] == calm[-1]
    assert bus.motor.bodies["a"] == 3.0


def test_an_agent_that_two_stages_of_a_host_share_keeps_its_former_state():
    """In the second stage #c0 holds #c1, whose result of the first stage counts as well."""
    bus = world(Walker.many("c", 40))
    bus.start()
    bus.run(1)
    before = str(bus.algorithm.scene)
    bus.hold(("down", "host-0"))
    bus.frame()
    rest = [f"AWalker#c{n}" for n in range(2, 40)]
    first = ["AWalker#c0<x=4>", "AWalker#c1", *rest]
    for part, nodes in enumerate((first, ["AWalker#c0(AWalker#c1)", *rest])):
        changed = {"~AWalker.1": VOCABULARY.read(" · ".join(nodes))}
        bus.put(m.EvolveReply("host-0", 1, part, changed))
        bus.settle()
    assert len(bus.records) == 2
    assert str(bus.algorithm.scene) == before
    assert bus.records[-1].changed["~AWalker.1"].pieces[0].count == 40


def test_a_view_that_a_later_stage_does_not_ask_for_is_refused():
    bus = world(Walker.many("c", 40))
    bus.start()
    bus.run(1)
    bus.hold(("down", "host-0"))
    bus.frame()
    forbidden = Walker.many("c", 40, x=4.0)
    patch = Delta(40, ("PPush",), ())
    bus.put(
        m.EvolveReply(
            "host-0", 1, 0, {"~AWalker.1": forbidden}, {}, {"eShow": {"~AWalker.1": EMPTY}}
        )
    )
    bus.settle()
    bus.put(m.EvolveReply("host-0", 1, 1, {}, {}, {"eShow": {"~AWalker.1": patch}}))
    bus.settle()
    said = "host-0: broke the protocol: it sent a view of eShow, which was not requested"
    assert said in bus.said


def test_negative_zero_comes_to_rest_as_zero_in_nodes_and_columns():
    columns = Cart.many("c", 40, push=-0.0)
    nodes = [rested(Scene((node,)), {node.id}, VOCABULARY.kinds) for node in columns.nodes]
    at_rest = rested(columns, {f"c{n}" for n in range(40)}, VOCABULARY.kinds)
    assert {str(node.nodes[0].state["push"]) for node in nodes} == {"0.0"}
    assert at_rest == Scene(tuple([node.nodes[0] for node in nodes]))
    assert rested(at_rest, {"c0"}, VOCABULARY.kinds) == at_rest


def test_agents_that_are_left_out_of_a_frame_carry_nothing_out():
    bus = world("ACart#a", ()).do("start, run 3, hold up host-0, frame")
    bus.handle(s.Skip("host-0"))
    bus.do("settle, release, settle")
    before = states(bus)["a"]["x"]
    bus.run(1)
    assert bus.motor.bodies["a"] == before


def test_a_kind_that_cannot_rest_is_named():
    with pytest.raises(MisuseError, match="AMouse: rest: no attribute pusch; did you mean"):

        class Mouse(Agent, symbol="AMouse", rest=("pusch",)):
            push: float = 0.0

    with pytest.raises(MisuseError, match="rest is a tuple of attributes"):

        class Rat(Agent, symbol="ARat", rest="push"):
            push: float = 0.0
