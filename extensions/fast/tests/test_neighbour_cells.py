"""`beside` in rules of cells, which machine code computes otherwise away from the edges."""

from itertools import product

import numpy as np
import pytest
from space_worlds import eStep

from minerva_bus import Reals, evolve, on
from minerva_bus.grammar.scene import agents
from minerva_bus.world.class_declaration import NotCompilable
from minerva_bus.world.context import Frame
from minerva_fast import ORDERED, SHUFFLED, CellGrid, Space, beside, interpreted, kernel, rule

OFFSETS = list(product(range(-2, 3), repeat=2))


@kernel
def weigh(total, place, lattice, cell):
    weight = 1.0
    for dy in range(-2, 3):
        for dx in range(-2, 3):
            other = beside(lattice, cell, dx, dy)
            weight += 1.0
            if other >= 0:
                total[place] += weight * other
            else:
                total[place] -= 100.0


@rule(ORDERED)
def weigh_own(cell: int, total: Reals, lattice: CellGrid):
    weigh(total, cell, lattice, cell)


@rule(SHUFFLED)
def weigh_shuffled(cell: int, total: Reals, lattice: CellGrid):
    weigh(total, cell, lattice, cell)


@rule(ORDERED)
def weigh_first(cell: int, total: Reals, lattice: CellGrid):
    weigh(total, cell, lattice, 0)


class Grid(Space, symbol="AGrid"):
    total: Reals

    @on("eStep")
    def step(self, step, moment):
        self.run(moment, weigh_own, weigh_shuffled, weigh_first)


def weight_of(cell, width, height, periodic):
    total, (y, x) = 0.0, divmod(cell, width)
    for number, (dy, dx) in enumerate(OFFSETS, 2):
        u, v = x + dx, y + dy
        if periodic:
            u, v = u % width, v % height
        inside = 0 <= u < width and 0 <= v < height
        total += number * (v * width + u) if inside else -100.0
    return total


@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize(("width", "height"), [(1, 1), (2, 3), (3, 2), (3, 3), (5, 4), (9, 7)])
def test_cells_beside_a_cell_are_those_of_the_definition(width, height, periodic):
    # More cells than the lattice has would be errors of `beside`, so the matrix is as large.
    grid = Grid("g", width=width, height=height, periodic=periodic, total=np.zeros((height, width)))
    expected = [
        2 * weight_of(cell, width, height, periodic) + weight_of(0, width, height, periodic)
        for cell in range(width * height)
    ]
    for as_python in (False, True):
        assert stepped(grid, as_python=as_python).ravel().tolist() == expected


def test_a_rule_of_cells_without_source_runs_as_python():
    scope = {"Reals": Reals}
    exec(
        compile("def count(cell: int, total: Reals):\n    total[cell] = cell", "<console>", "exec"),
        scope,
    )
    with pytest.warns(UserWarning, match="it runs as Python"):
        count = rule(ORDERED)(scope["count"])

    class Counted(Space, symbol="ACounted"):
        total: Reals

        @on("eStep")
        def step(self, step, moment):
            self.run(moment, count)

    field = Counted("c", width=3, height=2, total=np.zeros((2, 3)))
    scene = evolve(field.string, [eStep()], [Counted], Frame(0, seed=1)).scene
    (node,) = agents(scene)
    assert node.state["total"].tolist() == [[0, 1, 2], [3, 4, 5]]


def unpack(cell: int, total: Reals, lattice: CellGrid):
    width, _, _ = lattice  # pyright: ignore[reportAssignmentType]
    total[cell] = cell % width


def test_a_lattice_that_is_unpacked_is_an_error_that_names_its_attributes():
    with pytest.raises(NotCompilable, match=r"lattice\.width") as caught:
        rule(ORDERED)(unpack)
    assert "width, _, _ = lattice" in str(caught.value)


def stepped(grid, *, as_python):
    def step():
        scene = evolve(grid.string, [eStep()], [Grid], Frame(0, seed=1)).scene
        (node,) = agents(scene)
        return node.state["total"]

    if as_python:
        with interpreted():
            return step()
    return step()
