"""a^{d,h} of section 5: an agent that processes events of a type with a probability."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from minerva_bus import EMPTY, Agent, EventType, Frame, Vocabulary, evolve, on
from minerva_bus.errors import MisuseError, ProtocolError
from minerva_bus.frame.member_table import incompatibility
from minerva_bus.frame.messages import PROTOCOL_VERSION, Hello
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.scene import Scene
from minerva_bus.wire.vocabulary_codec import plain_vocabulary, read_vocabulary
from minerva_bus.world.event_collection import Priority, collect

eNear = EventType("eNear", by=float)
eCall = EventType("eCall")


class State(Agent):
    met: int = 0
    shy: float = 0.5
    x: float = 0.0
    births: int = 0


class One(State, symbol="AFox"):
    """Activities for a single agent."""

    @on("eNear", probability=0.3)
    def near(self, near, moment):
        self.met += 1
        self.x += near.by * moment.chance.random()
        return self.string + self.child(shy=self.shy) if self.met % 5 == 2 else None

    @on("eCall", probability="shy")
    def call(self, call, moment):
        self.shy -= 0.25
        return EMPTY if self.met > 3 else None


class Many(State, symbol="AFox"):
    """Activities for a population."""

    @on("eNear", probability=0.3, population=True)
    def near(self, near, moment):
        self.met += 1
        self.x += near.by * moment.chance.random()
        self.bear(self.met % 5 == 2, shy=self.shy)

    @on("eCall", probability="shy", population=True)
    def call(self, call, moment):
        self.shy -= 0.25
        self.die(self.met > 3)


class Together(Many):
    """All events of a type in a single call."""

    @on("eNear", probability=0.3, together=True)
    def near(self, near, moment):
        np.add.at(met := self.met.copy(), near.row, 1)
        self.met = met


class Certain(State, symbol="ADog"):
    @on("eNear")
    def near(self, near, moment):
        self.met += 1
        self.x = moment.chance.random()


VOCABULARY = Vocabulary.of(eNear, eCall, One)


def met(result):
    return np.array([node.state["met"] for node in result.scene.nodes])


def test_the_rate_is_the_probability():
    """Agents process 0.3 of 20,000 events, within 4 standard deviations."""
    w = Many.many("f", 200)
    answered = sum(
        int(met(evolve(w, [eNear(0)], [Many], Frame(t, 0.1, 5))).sum()) for t in range(100)
    )
    assert abs(answered / 20_000 - 0.3) < 4 * (0.3 * 0.7 / 20_000) ** 0.5


def test_each_event_of_a_frame_is_drawn_by_itself():
    w = Many.many("f", 2000)
    meetings = met(evolve(w, [eNear(1), eNear(2)], [Together], Frame(3, 0.1, 1)))
    shares = [np.count_nonzero(meetings == count) / 2000 for count in range(3)]
    assert shares == pytest.approx([0.49, 0.42, 0.09], abs=0.04)


@pytest.mark.parametrize(("shy", "expected"), [(-1.0, 0), (0.0, 0), (1.0, 1), (7.0, 1)])
def test_it_may_be_an_attribute_and_ends_are_certain(shy, expected):
    w = VOCABULARY.read(f"AFox#f<shy={shy}>")
    for t in range(20):
        state = evolve(w, [eCall()], [One], Frame(t)).scene.nodes[0].state
        assert state["shy"] == shy - 0.25 * expected


def test_the_probability_is_that_of_the_agent_when_it_processes_the_event():
    """Each processed call lowers the probability: from 0.25 there is never a second one."""
    w = VOCABULARY.read("AFox#f<shy=0.25>")
    shy = {
        evolve(w, [eCall(), eCall(receivers=["f"])], [One], Frame(t)).scene.nodes[0].state["shy"]
        for t in range(60)
    }
    assert shy == {0.25, 0.0}


def test_runs_repeat_and_differ_by_seed_frame_and_agent():
    w = Many.many("f", 64)

    def pattern(seed, t):
        return met(evolve(w, [eNear(1)], [Together], Frame(t, 0.1, seed))).tolist()

    assert pattern(1, 1) == pattern(1, 1)
    assert len({tuple(pattern(seed, t)) for seed in range(3) for t in range(3)}) == 9
    assert 0 < sum(pattern(1, 1)) < 64


def test_its_chance_takes_nothing_from_that_of_lambda():
    """An agent that processes the event draws the same number as one without a probability."""
    for t in range(12):
        sure = evolve(VOCABULARY_OF_DOGS.read("ADog#f"), [eNear(1)], [Certain], Frame(t))
        fox = evolve(VOCABULARY.read("AFox#f"), [eNear(1)], [One], Frame(t)).scene.nodes[0].state
        if fox["met"]:
            assert fox["x"] == sure.scene.nodes[0].state["x"]


VOCABULARY_OF_DOGS = Vocabulary.of(eNear, Certain)


@st.composite
def frames(draw):
    count = draw(st.sampled_from([1, 5, 33, 60]))
    shy = draw(st.lists(st.floats(-0.5, 1.5), min_size=count, max_size=count))
    ids = Ids.numbered("f", range(count))
    w = One.many(ids, shy=np.array(shy), met=np.arange(count) % 6)
    events = []
    for _ in range(draw(st.integers(1, 5))):
        rows = np.array(draw(st.lists(st.integers(0, count - 1), min_size=1, max_size=30)))
        condition = draw(st.sampled_from(["", "met > 1 or shy < 0.5", "not (met == 2)"]))
        to = ids.take(rows)
        events.append(
            draw(
                st.sampled_from(
                    [
                        eNear(1.0, condition=condition),
                        eNear(np.arange(1.0, len(rows) + 1), receivers=to, condition=condition),
                        eCall(condition=condition),
                        eCall(receivers=to),
                    ]
                )
            )
        )
    seed, number = draw(st.integers(0, 9)), draw(st.integers(0, 9))
    return w, collect(Priority(), {"a": events}), Frame(number, 0.1, seed)


@given(frames())
def test_one_by_one_is_all_at_once(frame):
    w, events, moment = frame
    strings = [
        str(evolve(string, events, [form], moment).scene)
        for form in (One, Many)
        for string in (w, Scene(w.nodes))
    ]
    assert strings == strings[:1] * 4


@given(frames(), st.data())
def test_it_does_not_depend_on_placement(frame, data):
    w, events, moment = frame
    part = w.pieces[0]
    at = data.draw(st.integers(0, part.count))
    cut = [half for half in (part.take(slice(0, at)), part.take(slice(at, None))) if half.count]
    together = EMPTY
    for piece in cut:
        together += evolve(Scene((piece,)), events, [Many], moment).scene
    assert together == evolve(w, events, [Many], moment).scene


# --- agent kind and wire format ---


def test_the_kind_has_its_chances():
    assert One.kind.chances == (("eCall", "shy"), ("eNear", 0.3))
    assert (One.kind.chance("eNear"), Certain.kind.chance("eNear")) == (0.3, 1.0)


def test_an_overriding_method_keeps_the_probability_unless_marked_again():
    class Kept(One, symbol="AKept"):
        def near(self, near, moment):
            self.met += 2

    class Marked(One, symbol="AMarked"):
        @on("eNear")
        def near(self, near, moment):
            self.met += 2

    assert Kept.kind.chance("eNear") == 0.3
    assert Marked.kind.chance("eNear") == 1.0


def test_a_vocabulary_has_them():
    plain = plain_vocabulary(VOCABULARY)
    assert plain["kinds"][0][2] == [["eCall", "shy"], ["eNear", 0.3]]
    assert read_vocabulary(plain).kinds == VOCABULARY.kinds
    assert plain_vocabulary(VOCABULARY_OF_DOGS)["kinds"][0][2] == ["eNear"]


@pytest.mark.parametrize("wrong", [1.5, -0.1, "name", "x", True, None, [0.5], float("nan")])
def test_an_invalid_probability_is_rejected(wrong):
    with pytest.raises(MisuseError, match="probability"):

        class Wrong(Agent, symbol="AWrong"):
            name: str = ""

            @on("eNear", probability=wrong)
            def near(self, near, moment):
                pass

    plain = plain_vocabulary(VOCABULARY)
    plain["kinds"][0][2] = [["eNear", wrong if wrong != "x" else "y"]]
    with pytest.raises(ProtocolError):
        read_vocabulary(plain)


def test_a_host_with_other_probabilities_may_not_join():
    (_, shy), (name, _) = sorted(One.kind.chances)
    other = replace(One.kind, chances=(("eCall", shy), (name, 0.4)))
    said = incompatibility(Hello("x", PROTOCOL_VERSION, kinds=(other,)), VOCABULARY)
    assert "its AFox has the probabilities (('eCall', 'shy'), ('eNear', 0.4)), the world's " in said
    assert not incompatibility(Hello("x", PROTOCOL_VERSION, kinds=(One.kind,)), VOCABULARY)
