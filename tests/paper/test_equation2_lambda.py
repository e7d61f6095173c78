"""Equation 2: λ(a, e^f) is a new string if f = d, and the agent itself if f ≠ d."""

import pytest

from minerva_bus import EMPTY, Agent, EventType, Metres, Primitive, Vocabulary, evolve, on, parse
from minerva_bus.errors import MisuseError
from minerva_bus.world.agent import ActivityError

PTail = Primitive("PTail")
eFeed = EventType("eFeed", amount=float)
eCall = EventType("eCall")
eBreak = EventType("eBreak", how=str)


class Fox(Agent, symbol="AFox"):
    x: Metres = 0.0
    energy: float = 1.0
    births: int = 0

    @on("eFeed")
    def feed(self, event, moment):
        self.energy += event.amount
        if self.energy <= 0:
            return EMPTY
        if self.energy > 100:
            return self.string + self.child(x=self.x) + PTail()
        return None

    @on("eCall")
    def call(self, event, moment):
        moment.emit(eFeed(amount=1.0, receivers=["b"]))

    @on("eBreak")
    def break_down(self, event, moment):
        return BREAKS[event.how](self, moment)


def swap(fox, moment):
    del fox.energy
    fox._energy = 1.0


def fail(fox, moment):
    raise ZeroDivisionError("by design")


BREAKS = {
    "raise": fail,
    "return": lambda fox, moment: "PTail",
    "assign": lambda fox, moment: setattr(fox, "energy", "much"),
    "invent": lambda fox, moment: setattr(fox, "enrgy", 2.0),
    "delete": lambda fox, moment: delattr(fox, "energy"),
    "swap": swap,
    "rename": lambda fox, moment: setattr(fox, "id", "other"),
    "scope": lambda fox, moment: setattr(fox, "scope", None),
    "nan": lambda fox, moment: setattr(fox, "energy", float("nan")),
    "huge": lambda fox, moment: setattr(fox, "energy", 10**400),
    "twice": lambda fox, moment: fox.string + fox.string,
    "emit": lambda fox, moment: moment.emit("eFeed"),
}


VOCABULARY = Vocabulary.of(PTail, eFeed, eCall, eBreak, Fox)


def lam(text, *events):
    return str(evolve(VOCABULARY.read(text), events, [Fox]).scene)


def test_the_state_changes():
    assert lam("AFox#a", eFeed(2.0)) == "AFox#a<x=0, energy=3, births=0>()"


def test_an_event_of_another_type_changes_nothing():
    w = VOCABULARY.read("AFox#a")
    assert evolve(w, [EventType("eOther")()], [Fox]).scene is w


def test_an_activity_that_changes_nothing_shares_the_agent():
    w = VOCABULARY.read("AFox#a")
    assert evolve(w, [eFeed(0.0)], [Fox]).scene is w


def test_the_result_need_not_contain_the_agent():
    assert lam("AFox#a", eFeed(-1.0)) == ""


def test_the_result_may_contain_more_than_the_agent():
    assert lam("AFox#a<x=2>", eFeed(200.0)) == (
        "AFox#a<x=2, energy=201, births=1>() · AFox#a:1<x=2, energy=1, births=0>() · PTail"
    )


def test_it_can_generate_events_for_the_next_frame():
    evolved = evolve(VOCABULARY.read("AFox#a · AFox#b"), [eCall(receivers=["a"])], [Fox])
    assert [str(event) for event in evolved.emitted["a"]] == ["eFeed<amount=1> from #a to #b"]
    assert str(evolved.scene) == str(VOCABULARY.read("AFox#a · AFox#b"))


@pytest.mark.parametrize(
    ("how", "cause", "said"),
    [
        ("raise", ZeroDivisionError, "by design"),
        ("return", TypeError, "an activity returns None or a string, not 'PTail'"),
        ("assign", MisuseError, "energy must be a number, not 'much'"),
        ("invent", MisuseError, "AFox#a has no enrgy, so it would be lost.*did you mean 'energy'"),
        ("delete", MisuseError, "energy has been deleted"),
        ("swap", MisuseError, "energy has been deleted"),
        ("rename", MisuseError, "an agent keeps its id"),
        ("scope", MisuseError, "the scope of #a must be a string"),
        ("nan", MisuseError, "energy must be a finite number, not (nan|inf)"),
        ("huge", MisuseError, "energy must be a finite number, not 1000"),
        ("twice", MisuseError, "2 agents with the id #a"),
        ("emit", MisuseError, "emit an event"),
    ],
)
def test_a_lambda_that_fails_names_the_agent_the_event_the_frame_and_the_cause(how, cause, said):
    with pytest.raises(ActivityError, match=said) as caught:
        lam("AFox#a", eBreak(how))
    assert f'Fox.break_down of AFox#a at eBreak<how="{how}"> in frame 0' in str(caught.value)
    assert isinstance(caught.value.__cause__, cause)


def test_attributes_with_an_underscore_are_not_part_of_the_state():
    class Shy(Agent, symbol="AShy"):
        n: int = 0

        @on("eCall")
        def call(self, event, moment):
            self._note = 1
            self.n += self._note

    w = Vocabulary.of(eCall, Shy).read("AShy#s")
    assert str(evolve(w, [eCall(), eCall()], [Shy]).scene) == "AShy#s<n=2>()"


def test_an_agent_can_become_one_of_another_kind_and_lives_on_as_such():
    class Grub(Agent, symbol="AGrub"):
        @on("eCall")
        def turn(self, event, moment):
            return Fox(self.id, energy=5.0).string

    w = Vocabulary.of(PTail, eFeed, eCall, eBreak, Fox, Grub).read("AGrub#a")
    events = [eFeed(1.0), eCall(), eFeed(2.0)]
    evolved = evolve(w, events, [Grub, Fox])
    assert str(evolved.scene) == "AFox#a<x=0, energy=7, births=0>()"
    assert evolved.emitted == {}, "a fox hears eCall too, but not the one that made it a fox"
    assert str(evolve(w, events, [Grub]).scene) == "AFox#a<x=0, energy=5, births=0>()"


def test_a_string_that_was_never_checked_is_completed_as_it_is_thawed():
    (fox,) = evolve(parse("AFox#a<x=150cm>"), [eFeed(0.0)], [Fox]).scene
    assert fox.state == {"x": 1.5, "energy": 1.0, "births": 0}
    with pytest.raises(ActivityError, match="AFox#a has no y"):
        evolve(parse("AFox#a<y=1>"), [eFeed(0.0)], [Fox])


def test_a_birth_counts_whether_the_string_is_made_before_or_after_it():
    w = lam("AFox#a", eFeed(200.0), eFeed(1.0))
    assert w.index("AFox#a:2<") < w.index("AFox#a:1<")
    assert "AFox#a<x=0, energy=202, births=2>" in w
