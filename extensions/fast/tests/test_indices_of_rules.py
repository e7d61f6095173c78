"""Indices of rules that are no row or cell: refused alike as machine code and as Python."""

import traceback
from contextlib import nullcontext
from pathlib import Path

import pytest
from space_worlds import Sheep, grow, meadow, moment

from minerva_bus import Cells
from minerva_fast import (
    ORDERED,
    SHUFFLED,
    Draws,
    beside,
    copy,
    interpreted,
    move_to,
    random,
    random_at,
    remove,
    rule,
    within,
)

COUNT, CELLS = 5, 16


@rule(SHUFFLED)
def stray(i: int, sheep: Sheep, grass: Cells, case: int, other: int, draws: Draws):
    sheep.energy[i] += random(draws)
    if i == 3 and case == 0:
        sheep.energy[i] = sheep.energy[other]
    elif i == 3 and case == 1:
        sheep.energy[other] = 7.0
    elif i == 3 and case == 2:
        grass[other] += 1
    elif i == 3 and case == 3:
        sheep.energy[i] = beside(sheep.lattice, other, 0, 1)
    elif i == 3 and case == 4:
        sheep.energy[i] = 1 / (other + 1)
    elif i == 3 and case == 5:
        grass[i] = 40_000 + other
    elif i == 3 and case == 6:
        move_to(sheep, i, other)


MISTAKES = {
    0: "sheep.energy[-1]: the index must be from 0 to 4",
    1: "sheep.energy[-1]: the index must be from 0 to 4",
    2: "grass[-1]: the index must be from 0 to 15",
    3: "a cell is outside of the lattice",
    4: "division by zero",
    5: "out of bounds for int16",
    6: "a cell is outside of the lattice",
}


def failure(context, rules, case, other=-1):
    """The message of an error, and the line of the rule that it names."""
    space = meadow(side=4, sheep=COUNT, wolves=0)
    with context(), pytest.raises((LookupError, ArithmeticError)) as caught:
        space.run(moment(), *rules, case=case, other=other)
    frames = traceback.extract_tb(caught.tb)
    (line,) = [each.line for each in frames if Path(each.filename) == Path(__file__)][1:]
    return str(caught.value), line


@pytest.mark.parametrize("case", MISTAKES)
def test_an_index_that_is_no_row_or_cell_is_an_error_at_its_line(case):
    message, line = failure(nullcontext, [grow, stray], case)
    assert (message, line) == failure(interpreted, [grow, stray], case)
    assert MISTAKES[case] in message
    assert "other" in line


@pytest.mark.parametrize(("case", "beyond"), [(0, COUNT), (2, CELLS), (6, CELLS)])
def test_room_for_newborns_and_cells_beyond_the_last_do_not_exist(case, beyond):
    assert failure(nullcontext, [stray], case, beyond) == failure(
        interpreted, [stray], case, beyond
    )


def test_an_activation_that_failed_once_is_undone_before_it_runs_as_python():
    @rule(ORDERED, births=0)
    def once(cell: int, grass: Cells, case: int, other: int):
        grass[cell] += 1
        if cell == 3 and grass[cell] == 1:
            grass[other] = case

    assert failure(nullcontext, [once], 0) == failure(interpreted, [once], 0)


@rule(ORDERED)
def search(i: int, sheep: Sheep, case: int, other: int, draws: Draws):
    if case == 0:
        sheep.energy[i] = within(sheep, sheep.cell[i], 1) + sheep.nearby[other]
    elif case == 1:
        sheep.energy[i] = within(sheep, other, 1)
    elif case == 2:
        sheep.energy[i] = random_at(sheep, other, draws)
    elif case == 3:
        copy(sheep, other)
    elif case == 4:
        remove(sheep, other)
    elif case == 5:
        remove(sheep, i)
        move_to(sheep, i, 1 - other)


@pytest.mark.parametrize(
    ("case", "mistake"),
    [
        (0, r"sheep.nearby\[-1\]"),
        (1, "outside of the lattice"),
        (2, "outside of the lattice"),
        (3, r"sheep.cell\[-1\]"),
        (4, r"sheep.cell\[-1\]"),
        (5, "a row that was removed"),
    ],
)
def test_functions_for_rules_refuse_what_is_no_row_or_cell(case, mistake):
    with interpreted(), pytest.raises(IndexError, match=mistake):
        meadow(sheep=COUNT, wolves=0).run(moment(), search, case=case, other=-1)
