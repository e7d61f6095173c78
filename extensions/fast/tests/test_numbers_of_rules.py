"""Numbers that rules get from `run`, from attributes and from their modules."""

import sys
from contextlib import nullcontext
from types import ModuleType

import numpy as np
import pytest
from space_worlds import Meadow, Sheep, eStep, meadow, moment

from minerva_bus import Cells, evolve, on
from minerva_bus.errors import MinervaError, MisuseError
from minerva_bus.user_code import report
from minerva_bus.world.class_declaration import NotCompilable
from minerva_fast import ORDERED, interpreted, rule

COLOURS = np.array([1, 2])
LIMIT = 3


settings = ModuleType("settings")
settings.ROW = 1


@rule(ORDERED)
def paint(cell: int, grass: Cells):
    grass[cell] = LIMIT + COLOURS[1] + settings.ROW


@rule(ORDERED)
def feed(i: int, sheep: Sheep, share: int, fast: bool = False):
    sheep.energy[i] += share


def halve(cell: int, grass: Cells):
    grass[cell] = 0.5 * grass[cell]


@rule(ORDERED)
def treble(i: int, sheep: Sheep, share: int):
    if i == 1:
        sheep.energy[i] = 3 * share


@rule(ORDERED)
def divide(i: int, sheep: Sheep, share: int):
    sheep.energy[i] = share % (1 - i)


def fed(**data):
    space = meadow(sheep=2, wolves=0)
    space.run(moment(), feed, **data)
    return Sheep.read(space.sheep).energy.tolist()


@pytest.fixture
def as_python():
    with interpreted():
        yield


@pytest.mark.parametrize("share", [1, 1.0, True, np.int64(1)])
def test_a_number_of_the_same_value_is_passed_in_the_type_of_the_rule(share, as_python):
    assert fed(share=share, fast=False) == [3, 3]


@pytest.mark.parametrize("share", [1.5, "1", None, float("nan"), float("inf")])
def test_a_number_that_the_type_cannot_hold_is_an_error(share, as_python):
    with pytest.raises(MisuseError, match="share must be int, as the rule declares, not "):
        fed(share=share, fast=False)


def test_a_number_that_no_rule_has_is_an_error(as_python):
    with pytest.raises(MisuseError, match="no rule of this `run` has a parameter shara; did you"):
        fed(shara=1)


PROBLEMS = [
    (treble, 2**53 // 3, ""),
    (
        treble,
        2**53 // 3 + 1,
        r"OverflowError: 9007199254740993 in sheep\.energy\[1\]: an int beyond ±2\^53",
    ),
    (
        treble,
        -(2**60),
        r"OverflowError: -3458764513820540928 in sheep\.energy\[1\]: an int beyond ±2\^53",
    ),
    (divide, 7, "ZeroDivisionError: integer .*modulo by zero"),
]


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize(("changed", "share", "problem"), PROBLEMS)
def test_a_number_that_cannot_enter_the_string_is_an_error(changed, share, problem, compiled):
    class Farm(Meadow, symbol="AMeadow"):
        @on("eStep")
        def step(self, step, moment):
            self.run(moment, changed, share=share)

    string = meadow(sheep=2, wolves=0).string
    with nullcontext() if compiled else interpreted():
        if not problem:
            evolve(string, [eStep()], [Farm])
            return
        with pytest.raises(MinervaError, match=f"Farm.step of AMeadow#m at .*{problem}") as raised:
            evolve(string, [eStep()], [Farm])
    assert f"in {changed.name}\n" in report(raised.value)


def test_a_real_in_cells_is_an_error():
    with pytest.raises(NotCompilable, match="Cells are ints"):
        rule(ORDERED)(halve)


def painted():
    space = meadow(sheep=0, wolves=0)
    paint.prepare()  # as a run does before its frames
    space.run(moment(), paint)
    return int(space.grass[0, 0])


@pytest.mark.parametrize(
    ("owner", "name", "value", "colour"),
    [
        (sys.modules[__name__], "LIMIT", 5, 8),
        (sys.modules[__name__], "COLOURS", np.array([1, 9]), 13),
        (settings, "ROW", 7, 12),
    ],
)
def test_a_constant_that_changes_is_compiled_again(monkeypatch, owner, name, value, colour):
    assert painted() == 6
    monkeypatch.setattr(owner, name, value)
    assert painted() == colour
