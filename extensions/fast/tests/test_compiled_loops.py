"""Loops of compiled methods, and numbers that are ints in one case and reals in another."""

from __future__ import annotations

import math
import operator

import numpy as np
import pytest

pytest.importorskip("numba")

from numba import njit
from twins import same

from minerva_bus import EMPTY, Agent, EventType, on
from minerva_fast import library
from minerva_fast.machine_code import NUMBA_OPTIONS

eDay = EventType("eDay", grass=float, count=int)
STEPS = ((0, 1), (1, 0), (0, -1), (-1, 0))
LABELLED = (("a", (0.5, 1)), ("b", (1.5, 2)))
NORTH = (0.0, 1.0)


def day(**data):
    return eDay(**{"grass": 1.0, "count": 3} | data)


def sown(cls, count=60, **state):
    x = np.round(np.random.default_rng(3).normal(size=count), 1)
    return cls.many("a", count, x=x, n=np.arange(count) % 7, **state)


def nearest_step(x, y):
    best = 0
    for dx, dy in STEPS:
        if dx * x + dy * y > best:
            best = dx * x + dy * y
    return best


def test_loops_over_tuples_that_are_written_or_constants():
    class Walker(Agent, symbol="AWalker"):
        ODD = (1, 3, 5)
        x: float = 0.0
        y: float = 0.0
        n: int = 0
        name: str = ""

        @on("eDay")
        def walk(self, day, moment):
            for dx in (-1, 0, 1):
                for dy in [-1, 0, 1]:
                    if dx == dy == 0:
                        continue
                    self.x += 0.1 * dx * moment.chance.random()
                    self.y += dy * 0.25 + dx
            for east, north in ((0, 1), (1, 0), NORTH):
                self.x += east * 0.5
                self.y -= north * day.grass
                if self.x > 2:
                    break
            for dx, dy in STEPS:
                if self.n == 3 and dx == -1:
                    return EMPTY
                self.n += 2 * dx - dy
            for odd in self.ODD:
                self.n += odd
            for word, (real, whole) in LABELLED:
                self.name = word
                self.x += real * whole
            for word in ("c", "d"):
                if self.x > 0.5:
                    self.name = word
                    break
            self.x += nearest_step(self.x, self.y)
            self.n %= 11

    same(Walker, sown(Walker), [[day()], [day(grass=-0.5), day()], [day()]], parts=3)


def test_values_of_a_chosen_tuple():
    class Drifter(Agent, symbol="ADrifter"):
        x: float = 0.0
        n: int = 0
        name: str = ""

        @on("eDay")
        def drift(self, day, moment):
            dx, dy = STEPS[moment.chance.integers(len(STEPS))]
            self.x += dx * moment.chance.random() + dy
            self.name, (real, self.n) = LABELLED[self.n % 2 - 2]
            self.x += real

    same(Drifter, sown(Drifter), [[day()], [day(), day()]])


def test_else_of_loops():
    class Seeker(Agent, symbol="ASeeker"):
        x: float = 0.0
        n: int = 0

        @on("eDay")
        def seek(self, day, moment):
            for dx in (-1, 0, 1):
                if self.n + dx == 2:
                    place = dx
                    break
            else:
                place = 7
            self.x += place
            while self.n > 3:
                self.n -= 1
                if self.n == 5:
                    break
            else:
                self.x += 100.0
            for turn in range(self.n):
                if turn == 2:
                    return None
            else:
                if self.x > 50:
                    return EMPTY
                self.x *= 2.0
            self.n += 5

    same(Seeker, sown(Seeker), [[day()], [day()], [day(), day()]])


def test_else_of_a_loop_over_events():
    class Hearer(Agent, symbol="AHearer"):
        x: float = 0.0
        n: int = 0

        @on("eDay", together=True, population=False)
        def hear(self, days, moment):
            for each in days:
                if each.count == self.n:
                    break
                self.x += each.grass
            else:
                self.x = -1.0

    same(Hearer, sown(Hearer), [[day()], [day(count=k) for k in range(3)]])


def test_enumerate_and_zip():
    class Counter(Agent, symbol="ACounter"):
        x: float = 0.0
        n: int = 0

        @on("eDay")
        def count(self, day, moment):
            counts = [0.0] * 4
            for i, (dx, dy) in enumerate(STEPS):
                counts[i] += dx * self.x - dy
            for i, value in enumerate(counts, 1):
                counts[i % 4] += value * 0.5
            for i, count in enumerate((2, 4), start=-1):
                self.n += i * count
            for value, weight, (dx, _) in zip(counts, (1.0, 0.5, 0.25), STEPS):  # noqa: B905  (of three lengths)
                if value > 3:
                    break
                self.x += value * weight + dx
            else:
                self.n += 1
            for (i, a), b in zip(enumerate(counts), NORTH):  # noqa: B905
                self.x += i * a * b
            self.n %= 9

    same(Counter, sown(Counter), [[day()], [day(), day()]])


def test_a_sum_that_begins_as_an_int():
    class Adder(Agent, symbol="AAdder"):
        x: float = 0.0
        y: float = 0.0
        z: float = 0.0
        back: float = 0.0
        n: int = 0

        @on("eDay")
        def add(self, day, moment):
            total = 0
            product = 1
            for _ in range(self.n):
                total += self.x
                product *= self.x
            self.y = total * 2 + 1
            self.z = -total - product * 3
            self.back = -total
            self.x += (total + self.n) // 2 - (total % 3) + total**2
            if total:
                product += self.n * total
            self.x = max(-9, min(9, self.x + product / 7))
            self.n = (self.n + int(total)) % 7
            if self.y != 1:
                self.y *= -2
            best = 0
            for dx in (-1, 0.5, 1):
                best = max(best, dx * self.n - 1)
            self.z += best - 1

        @on("eNight")
        def turn(self, night, moment):
            self.y = -self.y * 3

    same(Adder, sown(Adder), [[day()], [day(), day()], [day(count=1)]], parts=3)


def test_a_chain_of_variables_that_become_reals_one_by_one():
    class Queue(Agent, symbol="AQueue"):
        x: float = 0.0
        n: int = 0

        @on("eDay")
        def pass_on(self, day, moment):
            a = b = c = d = e = f = g = h = i = j = k = m = 0
            for _ in range(4 * self.n):
                a, b, c, d, e, f = b, c, d, e, f, g
                g, h, i, j, k, m = h, i, j, k, m, m + self.x
            self.x = a + 1

    same(Queue, sown(Queue), [[day()], [day()]])


MIXED = {
    "add_mixed": operator.add,
    "subtract_mixed": operator.sub,
    "multiply_mixed": operator.mul,
    "floor_divide_mixed": operator.floordiv,
    "modulo_mixed": operator.mod,
    "power_mixed": operator.pow,
}
WHOLE = (0, 1, -1, 2, -3, 7, 10**8, -(10**8) - 1, 2**52 + 1, 2**53 - 1, 2**53, -(2**53))
REAL = (-0.0, 0.5, -1.75, 1e300, 5e-324, 2.0**60, *map(float, WHOLE))


@pytest.mark.parametrize("name", MIXED)
def test_numbers_that_may_be_ints_give_the_results_of_python_or_a_fault(name):
    inner, faults = getattr(library, name), 0
    # Python calls kernels only.
    function = njit(**NUMBA_OPTIONS)(lambda a, b: inner(a, b))
    pairs = [(a, b) for a in (*WHOLE, *REAL) for b in (*WHOLE, *REAL)]
    if name == "power_mixed":
        pairs = [(a, b) for a, b in pairs if isinstance(b, int) and 0 <= b < 10]
    for a, b in pairs:
        try:
            expected = MIXED[name](a, b)
        except ArithmeticError:
            expected = None
        try:
            result = function(float(a), float(b))
        except ArithmeticError:
            faults += 1
            continue
        assert expected is not None, (a, b)
        # An int has no sign of zero, and is held exactly.
        assert result == expected, (a, b)
        assert math.copysign(1.0, result) == math.copysign(1.0, expected), (a, b)
    assert faults < 0.45 * len(pairs)
