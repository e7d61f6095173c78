"""Rules in the order SIMULTANEOUS whose result depends on the order of rows are refused."""

import pytest
from space_worlds import Bird, Resident, Sheep, meadow, moment, town

from minerva_bus import Cells, Reals
from minerva_bus.world.class_declaration import NotCompilable
from minerva_fast import (
    ORDERED,
    SIMULTANEOUS,
    CellGrid,
    Draws,
    beside,
    copy,
    go_to,
    interpreted,
    kernel,
    move_to,
    near,
    next_cell,
    remove,
    rule,
    within,
)


@kernel
def gather(row, table, other):
    table.energy[row] += table.energy[other]


@kernel
def feed(row, table):
    table.energy[row] += 1.0


def reads_another_row(i: int, sheep: Sheep):
    sheep.energy[i] = sheep.energy[i - 1]


def reads_another_row_although_it_has_before(i: int, sheep: Sheep, before: Sheep):
    sheep.energy[i] = before.energy[i] + sheep.energy[0]


def reads_another_cell(cell: int, grass: Cells, lattice: CellGrid):
    grass[cell] = grass[beside(lattice, cell, 1, 0)]


def reads_in_a_kernel(i: int, sheep: Sheep):
    gather(i, sheep, 0)


def searches_what_moves(i: int, birds: Bird):
    birds.seen[i] = near(birds, birds.x[i], birds.y[i], 1.0, i)
    go_to(birds, i, birds.x[i] + 1.0, 0.0)


def reads_its_own_cell_that_others_change(cell: int, grass: Cells, lattice: CellGrid):
    if grass[cell] == 0:
        grass[beside(lattice, cell, 1, 0)] = 1


def removes_another_row(i: int, sheep: Sheep):
    remove(sheep, i + 1)


def has_another_name(i: int, sheep: Sheep):
    energy = sheep.energy
    energy[i] = energy[0]
    sheep.energy[i] += 1.0


def has_another_row(i: int, sheep: Sheep):
    sheep.energy[i] += 1.0
    i += 1
    sheep.energy[i] = sheep.energy[i] + 1.0


@pytest.mark.parametrize(
    "function",
    [
        reads_another_row, reads_another_row_although_it_has_before, reads_another_cell,
        reads_in_a_kernel, searches_what_moves, reads_its_own_cell_that_others_change,
        removes_another_row, has_another_name, has_another_row,
    ],
)  # fmt: skip
def test_a_rule_that_notices_the_order_is_refused(function):
    with pytest.raises(NotCompilable, match="depends on the order of a SIMULTANEOUS rule") as error:
        rule(SIMULTANEOUS)(function)
    assert "before" in str(error.value)
    assert "test_simultaneous_rules.py" in str(error.value)
    assert rule(ORDERED)(function).name == function.__name__


def own_row(i: int, sheep: Sheep, grass: Cells, draws: Draws):
    sheep.energy[i] -= 1.0
    feed(i, sheep)
    grass[sheep.cell[i]] += 1
    move_to(sheep, i, next_cell(sheep.lattice, sheep.cell[i], draws))
    if sheep.energy[i] > 3:
        j = copy(sheep, i)
        sheep.energy[j] = sheep.energy[i] / 2
    elif sheep.energy[i] < 0:
        remove(sheep, i)


def unchanged_columns(i: int, birds: Bird):
    count = near(birds, birds.x[i], birds.y[i], 1.0, i)
    for k in range(count):
        birds.seen[i] += birds.x[birds.nearby[k]] + birds.dx[k]


def others_by_before(cell: int, scent: Reals, before: Reals, sheep: Sheep, lattice: CellGrid):
    scent[cell] = before[beside(lattice, cell, 1, 0)] + within(sheep, cell, 1) + len(scent)


def scattered(cell: int, scent: Reals, before: Reals):
    scent[cell // 2] += before[cell]


@pytest.mark.parametrize("function", [own_row, unchanged_columns, others_by_before, scattered])
def test_a_rule_that_does_not_notice_the_order_is_possible(function):
    assert rule(SIMULTANEOUS)(function).name == function.__name__


def test_what_a_rule_changes_elsewhere_takes_effect_in_the_order_of_rows():
    @rule(SIMULTANEOUS)
    def mark(i: int, sheep: Sheep, grass: Cells):
        grass[0] = i
        grass[1] += 1

    spaces = [meadow(sheep=5, wolves=0), meadow(sheep=5, wolves=0)]
    spaces[0].run(moment(), mark)
    with interpreted():
        spaces[1].run(moment(), mark)
    assert spaces[0].grass[0, :2].tolist() == spaces[1].grass[0, :2].tolist() == [4, 5]


def test_the_first_rule_of_a_frame_searches_the_state_before_it():
    @rule(SIMULTANEOUS, births=0)
    def count(i: int, residents: Resident, before: Resident):
        residents.near[i] = within(before, before.cell[i], 0)

    space = town()
    # As Python, so that rows that do not exist are an error and not read.
    with interpreted():
        space.run(moment(), count)
    assert set(Resident.read(space.residents).near) == {1}
