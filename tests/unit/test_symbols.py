"""Symbols: calls return strings and events; errors describe incorrect use."""

import pytest

from minerva_bus import (
    Default,
    Disc,
    Event,
    EventType,
    Label,
    Line,
    Metres,
    Motion,
    Primitive,
    Raster,
    Scene,
    Transformation,
)
from minerva_bus.errors import MisuseError, VocabularyError

PFox = Primitive("PFox", size=Default(float, 1.0), name=Default(str, ""))
TMove = Transformation("TMove", x=Metres, y=Default(Metres, 0.0))
eNear = EventType("eNear", distance=Metres, who=str)


def test_calling_a_primitive():
    assert str(PFox()) == 'PFox<size=1, name="">'
    assert str(PFox(2, name="x")) == 'PFox<size=2, name="x">'


def test_calling_a_transformation_twice():
    assert str(TMove(1)(PFox(), PFox(2))) == (
        'TMove<x=1, y=0>(PFox<size=1, name=""> · PFox<size=2, name="">)'
    )
    assert str(TMove(x=1, y=2)()) == "TMove<x=1, y=2>()"


def test_a_transformation_can_be_kept_and_used_again():
    aside = TMove(1)
    assert aside(PFox()) == aside(PFox())


def test_calling_an_event_type():
    event = eNear(1.5, "a", receivers=["b", "a", "b"], sender="c", condition="x > 1")
    assert (event.distance, event.who) == (1.5, "a")
    assert event.receivers == ("a", "b")
    assert str(event) == 'eNear<distance=1.5, who="a"> if x > 1 from #c to #a, #b'


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: PFox(1, "x", 3), "PFox takes 2 parameters, not 3"),
        (lambda: PFox(1, size=1), "PFox got size twice"),
        (lambda: PFox(siez=1), r"PFox has no siez \(it has size, name\); did you mean 'size'"),
        (lambda: PFox("big"), "PFox: size must be a number, not 'big'"),
        (lambda: TMove(), r"TMove needs a value for x \(real m\)"),
        (lambda: TMove(1)(PFox), "the scope of TMove takes strings, not"),
        (lambda: TMove(1)(TMove(2)), "a transformation twice to get a string"),
        (lambda: eNear(1.5), "eNear needs a value for who"),
        (lambda: eNear(1.5, "a", receivers="b"), "receivers must be a list of ids.* not 'b'"),
        (lambda: eNear(1.5, "a", receivers=PFox), "receivers must be a list of ids.* not <prim"),
        (lambda: eNear(1.5, "a", receivers=["b", 1]), "receivers must be a list of ids"),
        (lambda: eNear(1.5, "a", receivers=[PFox()]), "receivers must be a list of ids"),
        (lambda: Primitive("Fox"), "the name of a primitive must be P"),
        (lambda: Primitive("PFox-1"), "the name of a primitive"),
        (lambda: Primitive("PFöx"), r"a primitive must be P followed by letters \(A to Z\)"),
        (lambda: Transformation("PMove"), "the name of a transformation must be T"),
        (lambda: EventType("Near"), "the name of an event type must be e"),
        (lambda: Primitive("PFox", größe=int), r"letters \(A to Z\).*, not 'größe'"),
        (lambda: Primitive("PFox", size=Default(float, "x")), "the default of size must be"),
        (lambda: Primitive("PFox", size=complex), "not a parameter type"),
        (lambda: Primitive("PFox", form=Disc(0.2)), r"form: Disc\(...\) is .* after the name"),
        (lambda: Transformation("TX", by=Motion()), r"by: Motion\(...\) is not a parameter"),
        (lambda: EventType("eX", sender=str), "cannot have data named sender"),
        (lambda: EventType("eX", type=str), "cannot have data named type"),
        (lambda: EventType("eX", values=int), "cannot have data named values"),
        (lambda: Primitive("PX", Disc("r"), radius=float), "form of PX uses r, which is not one"),
        (lambda: Primitive("PX", Line("xs", "ys"), xs="list of real"), "uses ys"),
        (lambda: Primitive("PX", Label("tex"), text=str), "did you mean 'text'"),
        (lambda: Primitive("PX", Raster("m", "c"), m="cells"), "uses c"),
        (lambda: Transformation("TX", Motion(forward="d")), "uses d"),
        (lambda: Transformation("TX", Motion(spatial=("euler", "z", 0, 0))), "uses z"),
    ],
)
def test_misuse_names_the_mistake(call, said):
    with pytest.raises(MisuseError, match=said):
        call()


def test_a_condition_that_cannot_be_read_is_refused_where_it_is_made():
    with pytest.raises(VocabularyError):
        eNear(1.0, "a", condition="x >")


def test_parameters_may_be_called_name_and_self():
    assert str(Primitive("PX", name=str, self=int)("a", 1)) == 'PX<name="a", self=1>'
    assert EventType("eX", name=str, self=int)(name="a", self=1).name == "a"


def test_strings_are_not_added_to_anything_else():
    with pytest.raises(TypeError):
        PFox() + "PFox"
    with pytest.raises(TypeError):
        PFox() + TMove(1)
    assert PFox() != "PFox"
    assert isinstance(PFox() + PFox(), Scene)
    assert isinstance(eNear(1, "a"), Event)
