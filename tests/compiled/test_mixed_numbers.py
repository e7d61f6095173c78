"""Numbers of compiled methods that are ints in one case and reals in another."""

from __future__ import annotations

import math
import operator

import numpy as np
import pytest

pytest.importorskip("numba")

from minerva_bus import Agent, EventType, on
from minerva_bus.compiled import mixed_library
from tests.compiled.twins import same

eDay = EventType("eDay", grass=float, count=int)


def day(**data):
    return eDay(**{"grass": 1.0, "count": 3} | data)


def sown(count=60, **state):
    x = np.round(np.random.default_rng(3).normal(size=count), 1)
    return lambda cls: cls.many("a", count, x=x, n=np.arange(count) % 7, **state)


def test_a_sum_that_begins_as_an_int():
    def make(compiled):
        class Adder(Agent, symbol="AAdder"):
            x: float = 0.0
            y: float = 0.0
            z: float = 0.0
            back: float = 0.0
            n: int = 0

            @on("eDay", compiled=compiled)
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

            @on("eNight", compiled=compiled)
            def turn(self, night, moment):
                self.y = -self.y * 3

        return Adder

    same(make, sown(), [[day()], [day(), day()], [day(count=1)]], parts=3)


def test_a_chain_of_variables_that_become_reals_one_by_one():
    def make(compiled):
        class Queue(Agent, symbol="AQueue"):
            x: float = 0.0
            n: int = 0

            @on("eDay", compiled=compiled)
            def pass_on(self, day, moment):
                a = b = c = d = e = f = g = h = i = j = k = m = 0
                for _ in range(4 * self.n):
                    a, b, c, d, e, f = b, c, d, e, f, g
                    g, h, i, j, k, m = h, i, j, k, m, m + self.x
                self.x = a + 1

        return Queue

    same(make, sown(), [[day()], [day()]])


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
    function, faults = getattr(mixed_library, name), 0
    pairs = [(a, b) for a in (*WHOLE, *REAL) for b in (*WHOLE, *REAL)]
    if name == "power_mixed":
        pairs = [(a, b) for a, b in pairs if isinstance(b, int) and 0 <= b < 10]
    for a, b in pairs:
        state = np.zeros(3)
        result = function(state, float(a), float(b))
        try:
            expected = MIXED[name](a, b)
        except ArithmeticError:
            expected = None
        if state[0]:
            faults += 1
            continue
        assert expected is not None, (a, b)
        # An int has no sign of zero, and is held exactly.
        assert result == expected, (a, b)
        assert math.copysign(1.0, result) == math.copysign(1.0, expected), (a, b)
    assert faults < 0.45 * len(pairs)
