"""Figures of agents in pieces: those of columns are those of their rows as nodes."""

from math import inf

import pytest

from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.packing import packed
from minerva_bus.grammar.scene import EMPTY
from minerva_bus.grammar.symbols import Primitive, Transformation
from minerva_bus.regions.figures import figures_in, is_figure
from minerva_bus.world.halo import Halo

PSpot = Primitive("PSpot", who=str)
PEye = Primitive("PEye", who=str)
PTree = Primitive("PTree", age=float)
PLine = Primitive("PLine", who=float)
TMove = Transformation("TMove", x=float, y=float)
TUp = Transformation("TUp", x=float, z=float)

NEAR, ALL, EYES = Halo(1.0), Halo(inf), Halo(inf, figure="PEye")
COUNT = 40


def columns(figure):
    """A string of figures in columns, and the same ones as nodes."""
    nodes = packed(sum((figure(row) for row in range(COUNT)), EMPTY))
    (piece,) = nodes.pieces
    assert isinstance(piece, Columns)
    return piece, piece.nodes()


FIGURES = {
    "spot": lambda row: TMove(row + 0.5, -row)(PSpot(f"a{row}")),
    "whole numbers": lambda row: TMove(row, -row)(PSpot(f"a{row}")),
    "texts of any form": lambda row: TMove(row, -row)(PSpot("b" * (row % 3 + 1))),
    "empty texts": lambda row: TMove(row, -row)(PSpot("")),
    "no text": lambda row: TMove(row, -row)(PLine(row + 1)),
    "no id": lambda row: TMove(row, -row)(PTree(row)),
    "no coordinate": lambda row: TUp(row, -row)(PSpot(f"a{row}")),
    "an eye": lambda row: TMove(row, -row)(PEye(f"a{row}")),
    "no transformation": lambda row: PSpot(f"a{row}"),
}


@pytest.mark.parametrize("halo", [NEAR, ALL, EYES], ids=["near", "all", "eyes"])
@pytest.mark.parametrize("name", FIGURES)
def test_figures_in_columns_are_those_of_their_rows(name, halo):
    whole, nodes = columns(FIGURES[name])
    figures = figures_in(whole, halo)
    single = [figures_in(node, halo) for node in nodes]
    assert list(figures.who) == [who for each in single for who in each.who]
    for coordinate in figures.at:
        together = [value for each in single for value in each.at[coordinate].tolist()]
        assert str(figures.at[coordinate].tolist()) == str(together)
        assert len(together) == len(figures.who)
    assert is_figure(whole, halo) == all(is_figure(node, halo) for node in nodes)


@pytest.mark.parametrize(("name", "halo", "number", "all_are"), [
    ("spot", NEAR, COUNT, True), ("spot", ALL, COUNT, True), ("spot", EYES, 0, False),
    ("an eye", EYES, COUNT, True), ("no text", NEAR, 0, True), ("no text", ALL, 0, False),
    ("no id", NEAR, 0, False), ("no id", ALL, 0, False), ("no coordinate", NEAR, 0, False),
    ("no coordinate", ALL, COUNT, True), ("empty texts", NEAR, COUNT, False),
    ("no transformation", NEAR, 0, False), ("no transformation", ALL, COUNT, True),
])  # fmt: skip
def test_what_counts_as_a_figure(name, halo, number, all_are):
    whole, _ = columns(FIGURES[name])
    figures = figures_in(whole, halo)
    assert len(figures.who) == number
    assert is_figure(whole, halo) is all_are
    if number and not halo.everywhere:
        # Values are those of the figures, not only as many.
        assert figures.at["y"].tolist() == [-row for row in range(COUNT)]
    elif halo.everywhere:
        assert {key: values.tolist() for key, values in figures.at.items()} == {
            "x": [0.0] * number, "y": [0.0] * number
        }  # fmt: skip


def test_a_node_has_all_its_figures_if_none_of_them_needs_a_place():
    (piece,) = TMove(1, 2)(PSpot("a") + PEye("b") + PTree(3) + PSpot("c")).pieces
    assert list(figures_in(piece, ALL).who) == ["a", "b", "c"]
    assert list(figures_in(piece, EYES).who) == ["b"]
    assert is_figure(piece, ALL)
    assert not is_figure(piece, Halo(inf, figure="POther"))
