"""Numbers for which machine code and Python differ: in rules, Python's result or a fault."""

import itertools
import math
from contextlib import nullcontext

import numpy as np
import pytest

pytest.importorskip("numba")

from space_worlds import Sheep, meadow, moment

from minerva_bus import Cells, Reals, portable
from minerva_fast import ORDERED, CellGrid, Draws, beside, integers, interpreted, rule, within
from minerva_fast.draws import new_progress

TOP = 2**63
INTS = (0, 1, -1, 3, -7, 63, 64, -64, 2**31, 2**53, 2**53 + 1, -(2**53) - 1, TOP - 1, -TOP)
REALS = (
    0.0, -0.0, 1.0, 0.5, 2.5, -2.5, 0.1, 1e-310, 1e15 + 0.5, 2.0**53, 2.0**63, -(2.0**63), 1.7e308,
    1234.567, math.inf, -math.inf, math.nan,
)  # fmt: skip


def of_numbers(case, a, b, out):
    if case == 0:
        out[0] = a + b
    elif case == 1:
        out[0] = a - b
    elif case == 2:
        out[0] = a * b
    elif case == 3:
        out[0] = a / b
    elif case == 4:
        out[0] = a // b
    elif case == 5:
        out[0] = a % b
    elif case == 6:
        out[0] = -a
    elif case == 7:
        out[0] = abs(a)
    elif case == 8:
        out[0] = a < b
    elif case == 9:
        out[0] = a == b
    elif case == 10:
        out[0] = a >= b
    elif case == 11:
        out[0] = min(a, b)
    elif case == 12:
        out[0] = max(a, b, 1)
    elif case == 13:
        out[0] = a**2
    elif case == 14:
        out[0] = math.fmod(a, b)
    elif case == 15:
        out[0] = math.copysign(a, b)


def of_number(case, a, b, out):
    if case == 0:
        out[0] = int(a)
    elif case == 1:
        out[0] = round(a)
    elif case == 2:
        out[0] = math.floor(a)
    elif case == 3:
        out[0] = math.ceil(a)
    elif case == 4:
        out[0] = math.sqrt(a)
    elif case == 5:
        out[0] = math.log(a)
    elif case == 6:
        out[0] = math.exp(a)
    elif case == 7:
        out[0] = portable.log(a)
    elif case == 8:
        out[0] = portable.hypot(a, b)
    elif case == 9:
        out[0] = float(a)


def of_bits(case, a, b, out):
    if case == 0:
        out[0] = a << 7
    elif case == 1:
        out[0] = a >> 9
    elif case == 2:
        out[0] = a & b
    elif case == 3:
        out[0] = a ^ b
    elif case == 4:
        out[0] = ~a
    elif case == 5:
        out[0] = (a > b) + (a < b) - ~(a == b)


def result(function, *arguments):
    """The bits of a result, or None for an error."""
    out = np.full(1, 7.0)
    try:
        function(*arguments, out)
    except (ArithmeticError, ValueError, MemoryError):
        return None
    return math.nan if math.isnan(out[0]) else out.tobytes()


@pytest.mark.parametrize(
    ("function", "cases", "first", "second"),
    [
        (of_numbers, 16, INTS, INTS),
        (of_numbers, 16, INTS, REALS),
        (of_numbers, 16, REALS, INTS),
        (of_numbers, 16, REALS, REALS),
        (of_number, 10, REALS, (2.5,)),
        (of_number, 10, INTS, (3,)),
        (of_bits, 6, INTS, INTS),
    ],
)
@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # ~ of a bool
def test_machine_code_has_the_bits_of_python_or_a_fault(function, cases, first, second):
    def live(i: int, out: Reals, case: int, a, b):
        function(case, a, b, out)

    live.__annotations__ |= {"a": type(first[0]), "b": type(second[0])}
    run, rows = rule(ORDERED)(live).compiled(), np.zeros(1, np.int64)

    def compiled(case, a, b, out):
        run(0, 1, rows, new_progress(), np.zeros(1, np.uint64), out, case, a, b)

    faults = 0
    for case, a, b in itertools.product(range(cases), first, second):
        made, expected = result(compiled, case, a, b), result(function, case, a, b)
        faults += made is None
        if made is not None:
            assert made == expected or made is expected, (case, a, b)
    assert 0 < faults < 0.5 * cases * len(first) * len(second)


@rule(ORDERED)
def hash_rows(i: int, sheep: Sheep, factor: int):
    word = i + 1
    for _ in range(3):
        word = (word * factor + 1) % 1_000_003
    sheep.energy[i] = word


@rule(ORDERED)
def far(i: int, sheep: Sheep, step: int):
    sheep.energy[i] = beside(sheep.lattice, 5, step, step) + within(sheep, 5, step)


@rule(ORDERED)
def drawn(i: int, sheep: Sheep, draws: Draws, step: int):
    sheep.energy[i] = integers(draws, -step, step) / 1e18


def energies(name, **data):
    space = meadow(side=4, sheep=5, wolves=0)
    space.periodic = True
    space.run(moment(), name, **data)
    return Sheep.read(space.sheep).energy.tolist()


@pytest.mark.parametrize(
    ("name", "data"),
    [
        (hash_rows, {"factor": 6364136223846793005}),
        (far, {"step": 2**63 - 1}),
        (far, {"step": 2}),
        (drawn, {"step": 2**63 - 1}),
    ],
    ids=lambda each: getattr(each, "name", None),
)
def test_ints_of_any_length_have_the_results_of_python(name, data):
    with interpreted():
        expected = energies(name, **data)
    assert energies(name, **data) == expected
    assert len(set(expected)) == (1 if name is far else 5)


@rule(ORDERED)
def last_row_fails(i: int, sheep: Sheep, grass: Cells, bad: float):
    grass[i] += 1
    sheep.energy[i] = int(bad / (4 - i) if i < 4 else bad * math.inf)


@pytest.mark.parametrize("bad", [0.0, 1.0])
def test_an_error_is_that_of_python_and_changes_nothing(bad):
    errors = []
    for context in (interpreted, nullcontext):
        space = meadow(side=4, sheep=5, wolves=0)
        before = space.string
        with context(), pytest.raises((ValueError, OverflowError)) as caught:
            space.run(moment(), last_row_fails, bad=bad)
        errors.append((str(caught.value), caught.traceback[-1].lineno))
        if context is not interpreted:
            assert space.string == before
    assert errors[0] == errors[1]
    assert "cannot convert float" in errors[0][0]


@rule(ORDERED)
def one_row_is_too_large(i: int, sheep: Sheep, grass: Cells, lattice: CellGrid):
    grass[i] += 1
    number = 3**38 if i == 2 else i
    sheep.energy[i] = (number * number) % 1000 + lattice.width


def test_a_row_with_a_fault_runs_once():
    spaces = []
    for context in (interpreted, nullcontext):
        spaces.append(meadow(side=4, sheep=5, wolves=0))
        with context():
            spaces[-1].run(moment(), one_row_is_too_large)
    assert spaces[0].string.digest == spaces[1].string.digest
    assert spaces[1].grass[0].tolist() == [1, 1, 1, 1]
