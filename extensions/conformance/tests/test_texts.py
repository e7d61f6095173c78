"""How the conformance suite compares messages that mean the same."""

import pytest

from minerva_bus.frame import messages as m
from minerva_conformance.texts import KnownState, text_of


def text(figures: dict) -> str:
    return text_of(m.Report("member", figures), KnownState(), ("length",))


@pytest.mark.parametrize(("left", "right"), [(0, 0.0), (3, 3.0), (2**60, float(2**60)), (0, -0.0)])
def test_a_figure_is_a_number_whatever_its_type(left: int, right: float) -> None:
    assert text({"length": left}) == text({"length": right})


@pytest.mark.parametrize(("left", "right"), [(0, 0.5), (2**60 + 1, float(2**60)), (1, True)])
def test_other_figures_differ(left: int, right: float) -> None:
    assert text({"length": left}) != text({"length": right})


def test_a_missing_figure_differs_from_zero() -> None:
    assert text({}) != text({"length": 0})
