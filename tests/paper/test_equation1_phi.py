"""Equation 1: φ runs α, β and δ in a geometric system G."""

from contextlib import contextmanager

import pytest

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.parser import parse
from minerva_bus.semantics.geometry import Geometry, interpret


class Log(Geometry):
    """G logs its operations; the constructor omits `super().__init__()`, a common mistake."""

    def __init__(self):
        self.said = []

    def PStar(self, size=0):
        self.said.append(f"α star {size}")

    def PBroken(self):
        raise ZeroDivisionError

    @contextmanager
    def TMove(self, dist=0):
        self.said.append(f"β {dist}")
        yield
        self.said.append(f"δ {dist}")

    def TPlain(self):
        return None


def said(text):
    log = Log()
    interpret(parse(text), log)
    return log.said


def test_alpha_for_a_primitive():
    assert said("PStar<size=3>") == ["α star 3"]


def test_beta_then_the_scope_then_delta():
    assert said("TMove<dist=1>(PStar)") == ["β 1", "α star 0", "δ 1"]


def test_concatenation_from_left_to_right():
    assert said("PStar<size=1> · TMove(PStar<size=2>) · PStar<size=3>") == [
        "α star 1",
        "β 0",
        "α star 2",
        "δ 0",
        "α star 3",
    ]


def test_scopes_within_scopes():
    assert said("TMove<dist=1>(TMove<dist=2>(PStar) · TMove<dist=3>())") == [
        "β 1",
        "β 2",
        "α star 0",
        "δ 2",
        "β 3",
        "δ 3",
        "δ 1",
    ]


def test_the_empty_string_does_nothing():
    assert said("") == []


def test_symbols_without_a_meaning_in_this_system_do_nothing():
    assert said("PSound · TColour(PStar)") == ["α star 0"]


def test_phi_is_for_strings_without_agents():
    with pytest.raises(MisuseError, match="AFox#a"):
        said("TMove(AFox#a)")


def test_each_beta_gets_its_delta_even_when_drawing_fails():
    """Otherwise the next frame would start with the transformation of the failed one."""
    log = Log()
    with pytest.raises(ZeroDivisionError):
        interpret(parse("TMove<dist=1>(TMove<dist=2>(PBroken) · PStar)"), log)
    assert log.said == ["β 1", "β 2", "δ 2", "δ 1"]


def test_a_transformation_must_have_two_halves():
    with pytest.raises(MisuseError, match=r"Log\.TPlain must be a context manager"):
        said("TPlain(PStar)")


def test_parameters_arrive_by_name():
    with pytest.raises(TypeError, match="colour"):
        said("PStar<colour=1>")
