"""Equation 5: π applies θ to a whole string, and the result has no agents."""

from minerva_bus import (
    EMPTY,
    Agent,
    EventType,
    Primitive,
    Transformation,
    Vocabulary,
    view,
    visualize,
)

PDot = Primitive("PDot")
PBox = Primitive("PBox", n=int)
TFrame = Transformation("TFrame")
eDraw = EventType("eDraw", visual=True)
eSketch = EventType("eSketch", visual=True)


class Box(Agent, symbol="ABox"):
    n: int = 0

    @view("eDraw")
    def picture(self, event):
        return TFrame()(PBox(self.n), self.scope)

    @view("eSketch")
    def sketch(self, event):
        return PBox(self.n)


class Ghost(Agent, symbol="AGhost"):
    pass


VOCABULARY = Vocabulary.of(PDot, PBox, TFrame, eDraw, eSketch, Box, Ghost)


def pi(text, *events):
    return str(visualize(VOCABULARY.read(text), events, [Box, Ghost]))


def test_primitives_stay():
    w = VOCABULARY.read("PDot · PDot")
    assert visualize(w, [eDraw()], [Box]) is w


def test_a_transformation_stays_around_what_it_shows():
    assert pi("TFrame(ABox#a<n=1> · PDot)", eDraw()) == "TFrame(TFrame(PBox<n=1>) · PDot)"


def test_a_concatenation_is_shown_part_by_part():
    assert pi("ABox#a<n=1> · ABox#b<n=2>", eSketch()) == "PBox<n=1> · PBox<n=2>"


def test_an_agent_gets_its_scope_as_it_is_shown():
    """θ is applied to a(π(y, e^v))."""
    assert pi("ABox#a<n=1>(ABox#b<n=2>)", eDraw()) == "TFrame(PBox<n=1> · TFrame(PBox<n=2>))"


def test_a_view_may_leave_the_scope_out():
    assert pi("ABox#a<n=1>(ABox#b<n=2>)", eSketch()) == "PBox<n=1>"


def test_several_events_make_several_views_side_by_side():
    assert pi("ABox#a<n=1>", eSketch(), eDraw()) == "PBox<n=1> · TFrame(PBox<n=1>)"


def test_without_events_only_what_is_static_is_shown():
    assert pi("ABox#a · PDot · TFrame(ABox#b)") == "PDot · TFrame()"


def test_agents_without_views_are_not_shown_nor_is_what_is_in_them():
    assert pi("AGhost#g(PDot) · PDot", eDraw()) == "PDot"


def test_views_go_to_receivers_only():
    assert pi("ABox#a<n=1> · ABox#b<n=2>", eSketch(receivers=["b"])) == "PBox<n=2>"


def test_a_view_can_wait_for_a_condition():
    shown = pi("ABox#a<n=1> · ABox#b<n=2>", eSketch(condition="n > 1"))
    assert shown == "PBox<n=2>"


def test_the_empty_string_shows_nothing():
    assert visualize(EMPTY, [eDraw()], [Box]) is EMPTY
