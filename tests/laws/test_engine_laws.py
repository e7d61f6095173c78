"""Laws of η, π, φ and E (equations 1 and 3 to 6): the engine agrees with the paper."""

import re
from dataclasses import dataclass, field

import hypothesis.strategies as st
from hypothesis import HealthCheck, given, settings

from minerva_bus.grammar.condition import holds
from minerva_bus.grammar.scene import EMPTY, AgentNode, agents, rebuild, rescoped, scene_of
from minerva_bus.semantics.geometry import Geometry, interpret
from minerva_bus.world.agent import kinds_of
from minerva_bus.world.context import Context, Frame
from minerva_bus.world.event_collection import Priority, collect
from minerva_bus.world.evolution import Policy, evolve
from minerva_bus.world.visualization import visualize
from tests.family import FAMILY, FAMILY_VOCABULARY, family_events, family_strings
from tests.paper import transcription

law = settings(suppress_health_check=list(HealthCheck))
KINDS = kinds_of(FAMILY)
frames = st.builds(Frame, st.integers(0, 99), st.just(0.1), st.integers(0, 99))
lived = family_strings().flatmap(lambda w: st.tuples(st.just(w), family_events(w), frames))
seen = family_strings().flatmap(lambda w: st.tuples(st.just(w), family_events(w, visual=True)))


def concerns(event, agent, event_types):
    return (
        event.type in event_types
        and (not event.receivers or agent.id in event.receivers)
        and holds(event.condition, agent.state)
    )


@dataclass
class PlainLambda:
    """λ as in the paper, with the same agent classes and without the engine."""

    frame: Frame
    moments: dict = field(default_factory=dict)

    def __call__(self, agent, event):
        cls = KINDS[agent.symbol]
        if not concerns(event, agent, cls.activities):
            return scene_of(agent)
        thawed = cls.thaw(agent)
        moment = self.moments.setdefault(agent.id, Context(self.frame, f"#{agent.id}"))
        result = cls.activities[event.type](thawed, event, moment)
        return thawed.string if result is None else result

    @property
    def emitted(self):
        return {who: tuple(m.emitted) for who, m in self.moments.items() if m.emitted}


def plain_theta(agent, event):
    cls = KINDS[agent.symbol]
    if not concerns(event, agent, cls.views):
        return EMPTY
    return cls.views[event.type](cls.thaw(agent), event)


@law
@given(lived)
def test_evolve_is_equation_3_with_events_one_after_another(case):
    w, events, frame = case
    lam = PlainLambda(frame)
    evolved = evolve(w, events, FAMILY, frame)
    assert evolved.scene == transcription.eta_sequential(w, events, lam)
    assert evolved.emitted == lam.emitted


@law
@given(lived)
def test_evolve_is_equation_3_to_the_letter(case):
    """Copies of an agent have distinct ids in the engine (`a`, `a:7-2`), but not in the paper."""
    w, events, frame = case
    evolved = evolve(w, events, FAMILY, frame, Policy.LITERAL)
    literal = transcription.eta(w, events, PlainLambda(frame))
    assert without_copies(evolved.scene) == without_copies(literal)
    ids = [agent.id for agent in agents(evolved.scene)]
    assert len(ids) == len(set(ids))


def without_copies(scene):
    """The string with ids such as `a:7-2` reduced to `a`."""

    def leave(node, scope):
        node = rescoped(node, scope)
        if not isinstance(node, AgentNode):
            return node
        name = re.sub(r":\d+-\d+(-\d+)?(?=:|$)", "", node.id)
        return AgentNode(node.symbol, name, node.names, node.values, node.scope)

    return rebuild(scene, leave)


@law
@given(family_strings().flatmap(lambda w: st.tuples(st.just(w), family_events(w))))
def test_with_one_event_both_readings_of_equation_3_are_one(case):
    w, events = case
    for event in events[:1]:
        literal = evolve(w, [event], FAMILY, policy=Policy.LITERAL)
        assert evolve(w, [event], FAMILY) == literal


@law
@given(lived)
def test_evolved_strings_stay_in_their_world(case):
    w, events, frame = case
    evolved = evolve(w, events, FAMILY, frame).scene
    assert FAMILY_VOCABULARY.check(evolved) == evolved


@law
@given(family_strings())
def test_without_events_nothing_changes(w):
    assert evolve(w, [], FAMILY).scene is w


@law
@given(lived)
def test_parts_without_events_are_shared(case):
    w, events, frame = case
    evolved = evolve(w, events, [], frame)
    assert evolved.scene is w
    assert evolved.emitted == {}


@law
@given(lived, st.integers(0, 4))
def test_eta_distributes_over_concatenation(case, cut):
    w, events, frame = case
    s, t = type(w)(w.nodes[:cut]), type(w)(w.nodes[cut:])
    both = [evolve(part, events, FAMILY, frame) for part in (s, t)]
    whole = evolve(w, events, FAMILY, frame)
    assert whole.scene == both[0].scene + both[1].scene
    assert whole.emitted == both[0].emitted | both[1].emitted


@law
@given(lived, lived)
def test_an_agent_never_knows_of_the_others(case, other):
    """An agent evolves the same alone and with others, so hosts can share the work."""
    w, events, frame = case
    for node in w.nodes:
        alone = evolve(scene_of(node), events, FAMILY, frame).scene
        again = evolve(scene_of(node) + other[0], events, FAMILY, frame).scene
        assert str(again).startswith(str(alone))


@law
@given(seen)
def test_visualize_is_equation_5(case):
    w, events = case
    assert visualize(w, events, FAMILY) == transcription.pi(w, events, plain_theta)


@law
@given(seen)
def test_a_view_is_of_the_language_without_agents(case):
    w, events = case
    z = visualize(w, events, FAMILY)
    assert list(agents(z)) == []
    assert FAMILY_VOCABULARY.check(z) == z
    assert visualize(z, events, FAMILY) is z


class Log(Geometry):
    """A geometric system that logs the operations on it."""

    def __init__(self):
        self.said = []

    def draw(self, figure):
        self.said.append(("α", figure.symbol, figure.values))

    def enter(self, transformation):
        self.said.append(("β", transformation.symbol, transformation.values))

    def leave(self, transformation):
        self.said.append(("δ", transformation.symbol, transformation.values))


@law
@given(seen)
def test_interpret_is_equation_1(case):
    z = visualize(*case, FAMILY)
    log, paper = Log(), Log()
    interpret(z, log)
    transcription.phi(z, paper.draw, paper.enter, paper.leave)
    assert log.said == paper.said


sources = family_strings().flatmap(
    lambda w: st.dictionaries(st.sampled_from("abcd"), family_events(w), max_size=4)
)


@law
@given(sources, st.permutations(sorted(FAMILY_VOCABULARY.events)), st.randoms())
def test_collect_does_not_depend_on_arrival(sources, order, chance):
    arrived = list(sources.items())
    chance.shuffle(arrived)
    assert collect(Priority(tuple(order)), dict(arrived)) == collect(
        Priority(tuple(order)), sources
    )


@law
@given(sources, st.permutations(sorted(FAMILY_VOCABULARY.events)))
def test_collect_is_equation_6(sources, order):
    """The paper's generators make one event type each, so they are called in priority order."""
    generators = [
        lambda t, source=source, event_type=event_type: [
            event for event in sources[source] if event.type == event_type
        ]
        for event_type in order
        for source in sorted(sources)
    ]
    assert collect(Priority(tuple(order)), sources) == transcription.collect(generators, 0)
