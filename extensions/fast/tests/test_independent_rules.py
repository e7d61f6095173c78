"""Rules that threads may share: which they are, and that the string stays the same."""

import os
import signal

import pytest
from space_worlds import Bird, eStep, flock, grow, meadow, moment

from minerva_bus import Cells, Reals, on
from minerva_fast import (
    ORDERED,
    SHUFFLED,
    SIMULTANEOUS,
    CellGrid,
    Draws,
    Space,
    beside,
    copy,
    driving,
    go_to,
    kernel,
    near,
    random,
    rule,
)


@kernel
def turn(row, table, seen, angle):
    count = near(seen, seen.x[row], seen.y[row], 4.0, row)
    for k in range(count):
        table.seen[row] += seen.nearby[k] * angle
    go_to(table, row, table.x[row] + 0.7, table.y[row] - seen.dx[0] if count else 0.0)


@kernel
def touch(row, table):
    table.seen[row + 1] += 1


@rule(SIMULTANEOUS, births=0)
def fly(i: int, birds: Bird, before: Bird):
    if before.x[i] < 0:
        birds.seen[i] = before.x[i - 1000]
    turn(i, seen=before, table=birds, angle=0.5)


@rule(SIMULTANEOUS)
def spread(cell: int, ground: Cells, before: Cells, lattice: CellGrid):
    other = beside(lattice, cell, 1, 0)
    if other >= 0 and before[other]:
        ground[cell] += 1


@rule(ORDERED, births=0)
def age(i: int, birds: Bird):
    birds.seen[i] = birds.x[i] + birds.field.width


@rule(SHUFFLED)
def shuffled(i: int, birds: Bird):
    birds.seen[i] = 1


@rule(SIMULTANEOUS)
def drawn(i: int, birds: Bird, draws: Draws):
    birds.seen[i] = random(draws)


@rule(ORDERED)
def reads_another_row(i: int, birds: Bird):
    birds.seen[i] = birds.seen[i - 1]


@rule(ORDERED)
def searches_what_changes(i: int, birds: Bird):
    birds.seen[i] = near(birds, birds.x[i], birds.y[i], 1.0, i)


@rule(ORDERED)
def writes_another_row(i: int, birds: Bird):
    touch(i, birds)


@rule(ORDERED)
def writes_another_table(i: int, birds: Bird, hawks: Bird):
    hawks.seen[i] = 1


@rule(ORDERED)
def writes_under_another_name(i: int, birds: Bird, hawks: Bird):
    seen = hawks.seen
    seen[i] = 1


@rule(ORDERED)
def has_another_name(i: int, birds: Bird):
    flown = birds
    flown.seen[0] = 1


@rule(ORDERED)
def changes_the_row(i: int, birds: Bird):
    i += 1
    birds.seen[i] = 1


@rule(ORDERED)
def reads_the_cell(i: int, birds: Bird):
    birds.seen[i] = birds.cell[i]


@rule(ORDERED)
def moves_often(i: int, birds: Bird):
    for k in range(3):
        go_to(birds, i, birds.x[i] + k, birds.y[i])


@rule(ORDERED)
def moves_twice(i: int, birds: Bird):
    go_to(birds, i, birds.x[i] + 1, birds.y[i])
    go_to(birds, i, birds.x[i] - 1, birds.y[i])


@rule(ORDERED)
def moves_another(i: int, birds: Bird, hawks: Bird):
    go_to(hawks, i, birds.x[i], birds.y[i])


@rule(ORDERED)
def copies(i: int, birds: Bird):
    copy(birds, i)


@pytest.mark.parametrize("each", [fly, spread, age, grow], ids=lambda each: each.name)
def test_a_rule_of_its_own_row_is_independent(each):
    assert each.checked.independent
    assert each.checked.calls(go_to) == (each is fly)


@pytest.mark.parametrize(
    "each",
    [
        shuffled, drawn, reads_another_row, searches_what_changes, writes_another_row,
        writes_another_table, writes_under_another_name, has_another_name, changes_the_row,
        reads_the_cell, moves_often, moves_twice, moves_another, copies,
    ],
    ids=lambda each: each.name,
)  # fmt: skip
def test_a_rule_that_other_rows_can_notice_is_dependent(each):
    assert not each.checked.independent


class Sky(Space, symbol="ASky"):
    birds: Reals

    @on("eStep")
    def step(self, step, moment):
        self.run(moment, fly, fly)


def sky(count=50):
    return Sky("s", width=12, height=12, periodic=True, births=count,
               birds=flock(count, 12.0, 12.0).birds)  # fmt: skip


@pytest.fixture
def threads(monkeypatch):
    """A function that sets the number of threads, also for few rows."""
    monkeypatch.setattr(driving, "_ROWS", 1)
    return lambda count: monkeypatch.setenv(driving.THREADS, str(count))


@pytest.mark.parametrize("make", [sky, meadow])
def test_any_number_of_threads_gives_the_same_string(threads, make):
    digests = set()
    for count in (1, 2, 5):
        threads(count)
        space = make()
        for frame in range(4):
            space.step(eStep(), moment(frame))
        digests.add(space.string.digest)
    assert len(digests) == 1
    assert digests != {make().string.digest}


def test_a_forked_process_and_its_parent_have_threads_of_their_own(threads):
    threads(3)
    first, second = sky(), sky()
    first.step(eStep(), moment())
    expected = first.string.digest
    child = os.fork()
    if not child:
        signal.alarm(30)  # It would wait forever for threads that it does not have.
        second.step(eStep(), moment())
        os._exit(second.string.digest != expected)
    second.step(eStep(), moment())
    assert second.string.digest == expected
    assert os.waitpid(child, 0)[1] == 0


def test_the_first_row_with_an_error_is_reported(threads):
    threads(3)
    space = sky()
    birds = space.birds.copy()
    birds[1, [20, 45]] = -1.0
    space.birds = birds
    with pytest.raises(IndexError, match=r"before\.x\[-980\]"):
        space.step(eStep(), moment())
    assert (space.birds == birds).all()
