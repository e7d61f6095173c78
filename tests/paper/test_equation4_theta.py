"""Equation 4: θ(a, e^f) represents an agent by primitives and transformations, or by ε."""

import pytest

from minerva_bus import (
    EMPTY,
    Agent,
    EventType,
    Metres,
    Motion,
    Primitive,
    Transformation,
    Vocabulary,
    on,
    view,
    visualize,
)
from minerva_bus.errors import MisuseError
from minerva_bus.world.agent import ActivityError

PFox = Primitive("PFox")
PPlace = Primitive("PPlace", x=Metres)
TMove = Transformation("TMove", Motion(forward="dist"), dist=Metres)
eDraw = EventType("eDraw", visual=True)
ePlan = EventType("ePlan", visual=True)
eBad = EventType("eBad", visual=True, how=str)
eHit = EventType("eHit")


class Fox(Agent, symbol="AFox"):
    x: Metres = 0.0

    @on("eHit")
    def hit(self, event, moment):
        self.x = 99.0

    @view("eDraw")
    def picture(self, event):
        self.x += 1.0  # a view has no effect on the state: this is discarded
        return TMove(self.x - 1.0)(PFox())

    @view("ePlan")
    def plan(self, event):
        return PPlace(self.x)

    @view("eBad")
    def bad(self, event):
        return {"agent": TMove(1.0)(self.string), "none": None}[event.how]


VOCABULARY = Vocabulary.of(PFox, PPlace, TMove, eDraw, ePlan, eBad, eHit, Fox)


def theta(*events, text="AFox#a<x=2>"):
    return visualize(VOCABULARY.read(text), events, [Fox])


def test_a_view_shows_the_agent_by_its_state():
    assert str(theta(eDraw())) == "TMove<dist=2>(PFox)"


def test_different_visual_events_make_different_views():
    assert str(theta(ePlan())) == "PPlace<x=2>"


def test_an_event_of_another_type_shows_nothing():
    assert theta(EventType("eOther", visual=True)()) is EMPTY


def test_an_event_that_is_not_visual_shows_nothing():
    """d ∈ V: views are separate from evolution."""
    assert theta(eHit()) is EMPTY


def test_an_agent_without_a_class_here_shows_nothing():
    assert visualize(VOCABULARY.read("AFox#a"), [eDraw()], []) is EMPTY


def test_a_view_leaves_the_agent_as_it_is():
    assert str(theta(eDraw(), eDraw())) == "TMove<dist=2>(PFox) · TMove<dist=2>(PFox)"


@pytest.mark.parametrize(
    ("how", "cause", "said"),
    [
        ("agent", MisuseError, r"a view is a string of L\(E\): AFox#a is an agent"),
        ("none", TypeError, "a view returns a string, not None"),
        ("else", KeyError, "else"),
    ],
)
def test_a_failing_view_reports_its_line(how, cause, said):
    with pytest.raises(ActivityError, match=said) as caught:
        visualize(VOCABULARY.read("AFox#a"), [eBad(how)], [Fox], frame=7)
    assert isinstance(caught.value.__cause__, cause)
    assert f'of AFox#a at eBad<how="{how}"> in frame 7' in str(caught.value)
