"""Matrices that rules read and change: the string before a rule stays as it is."""

from contextlib import nullcontext

import numpy as np
import pytest
from space_worlds import eStep

from minerva_bus import Cells, Reals, evolve, on
from minerva_bus.grammar.scene import agents
from minerva_bus.world.context import Frame
from minerva_fast import ORDERED, SIMULTANEOUS, Space, interpreted, kernel, rule

SIZE = 6


@rule(ORDERED)
def read_both(cell: int, total: Reals, ground: Cells, heat: Reals):
    total[cell] += ground[cell] + heat[len(heat) - 1 - cell]


@rule(ORDERED)
def change_other(cell: int, total: Reals, ground: Cells, heat: Reals):
    ground[cell] += 1
    total[cell] += ground[cell]


@rule(ORDERED)
def change_alias(cell: int, total: Reals, ground: Cells, heat: Reals):
    other = heat
    other[cell] += 1
    total[cell] += other[cell]


@kernel
def warm(heat, cell):
    heat[cell] *= 2


@rule(ORDERED)
def change_in_kernel(cell: int, total: Reals, ground: Cells, heat: Reals):
    warm(heat, cell)
    total[cell] += heat[cell]


@rule(SIMULTANEOUS)
def shift(cell: int, total: Reals, before: Reals):
    total[cell] = before[cell - 1] if cell > 0 else before[len(before) - 1]


@rule(ORDERED)
def keep(cell: int, ground: Cells, heat: Reals):
    if cell < 0:
        ground[cell] = 0


RULES = [read_both, shift, change_other, shift, change_alias, read_both, change_in_kernel, keep]


class Plate(Space, symbol="APlate"):
    total: Reals
    ground: Cells
    heat: Reals
    written: bool = False

    @on("eStep")
    def step(self, step, moment):
        if self.written:  # as methods do that also change a matrix themselves
            for name in ("total", "ground", "heat"):
                self.writable(name)[0, 0] += 1
        self.run(moment, *RULES)
        self.run(moment, shift, read_both)
        if self.written:
            self.total *= 2  # writable, as rules have changed it


def plate(**state):
    numbers = np.arange(float(SIZE)).reshape(2, 3)
    return Plate("p", total=numbers, ground=numbers.astype(np.int16), heat=numbers, **state)


def expected(total, ground, heat, written):
    total, ground, heat = (np.array(each, float).ravel() for each in (total, ground, heat))
    if written:
        for each in (total, ground, heat):
            each[0] += 1
    total = np.roll(total + ground + heat[::-1], 1)
    ground += 1
    total = np.roll(total + ground, 1)
    heat += 1
    total = total + heat + ground + heat[::-1]
    heat *= 2
    total = np.roll(total + heat, 1) + ground + heat[::-1]
    total *= 1 + written
    return [each.tolist() for each in (total, ground, heat)]


@pytest.mark.parametrize("written", [False, True])
@pytest.mark.parametrize("as_python", [False, True])
def test_rules_change_no_string_but_the_next(as_python, written):
    scene = plate(width=3, height=2, written=written).string
    for number in range(3):
        (old,) = agents(scene)
        was = {name: np.array(old.state[name]) for name in ("total", "ground", "heat")}
        with interpreted() if as_python else nullcontext():
            scene = evolve(scene, [eStep()], [Plate], Frame(number, seed=1)).scene
        (new,) = agents(scene)
        for name, matrix in was.items():
            assert (old.state[name] == matrix).all()
        matrices = [new.state[name].ravel().tolist() for name in was]
        assert matrices == expected(was["total"], was["ground"], was["heat"], written)
        assert not any(new.state[name].flags.writeable for name in was)


def test_matrices_that_rules_only_read_keep_their_memory():
    assert read_both.checked.only_read == {"before", "ground", "heat"}
    assert change_other.checked.only_read == {"before", "heat"}
    assert change_alias.checked.only_read == {"before", "ground"}
    assert change_in_kernel.checked.only_read == {"before", "ground"}
    assert shift.checked.only_read == {"before"}
    assert keep.checked.only_read == {"before", "heat"}
    scene = plate(width=3, height=2).string
    (old,) = agents(scene)

    class Reader(Plate, symbol="AReader"):
        @on("eStep")
        def step(self, step, moment):
            self.run(moment, read_both)

    reader = Reader(
        "p", width=3, height=2, **{k: old.state[k] for k in ("total", "ground", "heat")}
    )
    (new,) = agents(evolve(reader.string, [eStep()], [Reader], Frame(0, seed=1)).scene)
    assert new.state["heat"] is old.state["heat"]
    assert new.state["ground"] is old.state["ground"]


@pytest.mark.parametrize("layout", ["unaligned", "transposed"])
def test_matrices_of_other_layouts_are_read(layout):
    numbers = np.arange(float(SIZE)).reshape(2, 3)
    if layout == "unaligned":
        heat = np.frombuffer(b"." + numbers.tobytes(), offset=1).reshape(2, 3)
    else:
        heat = np.asfortranarray(numbers)

    class Given(Plate, symbol="AGiven"):
        @on("eStep")
        def step(self, step, moment):
            heat.flags.writeable = False
            self.heat = heat
            self.run(moment, read_both)

    given = Given(
        "p", width=3, height=2, total=numbers, ground=numbers.astype(np.int16), heat=numbers
    )
    (new,) = agents(evolve(given.string, [eStep()], [Given], Frame(0, seed=1)).scene)
    assert (
        new.state["total"].tolist() == (2 * numbers + numbers.ravel()[::-1].reshape(2, 3)).tolist()
    )
