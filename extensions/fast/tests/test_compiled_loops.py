"""Loops of compiled methods."""

from __future__ import annotations

import struct
import sys

import numpy as np
import pytest

pytest.importorskip("numba")

from twins import same

from minerva_bus import EMPTY, Agent, EventType, on

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
    best = 0.0
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
            for east, north in ((0.0, 1.0), (1.0, 0.0), NORTH):
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


TRIPLED = """from minerva_fast.library import *

@inlined
def part(number):
    return multiply(number, 3)

@kernel(int64(int64))
def run(number):
    return part(number)
"""


def test_machine_code_is_kept_and_a_damaged_file_is_replaced(tmp_path, monkeypatch):
    from minerva_fast import machine_code

    made, compiled = [], machine_code._compiled

    def noted(name, text):
        made.append(name)
        return compiled(name, text)

    load = machine_code.load_kernel.__wrapped__  # as another process does
    monkeypatch.setattr(machine_code, "_compiled", noted)
    monkeypatch.setattr(machine_code, "cache_folder", lambda: tmp_path)
    assert load(TRIPLED, "a test")(-7) == -21
    (kept,) = tmp_path.glob("*.code")
    whole = kept.read_bytes()
    assert load(TRIPLED, "a test")(5) == 15
    assert len(made) == 1
    for damaged in (whole[:-1], whole[:100] + b"?" + whole[101:], b""):
        kept.write_bytes(damaged)
        assert load(TRIPLED, "a test")(5) == 15
        assert kept.read_bytes()[32:] == machine_code._kept(kept)
    assert len(made) == 4


@pytest.mark.skipif(sys.platform != "linux", reason="reads the symbols of an ELF file")
def test_a_kernel_has_no_names_that_others_see(tmp_path, monkeypatch):
    from minerva_fast import machine_code

    monkeypatch.setattr(machine_code, "cache_folder", lambda: tmp_path)
    text = TRIPLED.replace("multiply", "floor_divide").replace("@inlined", "@compiled")
    assert machine_code.load_kernel(text, "a test")(7) == 2
    code = machine_code._kept(next(tmp_path.glob("*.code")))
    (start,) = struct.unpack_from("<Q", code, 0x28)
    size, count = struct.unpack_from("<HH", code, 0x3A)
    sections = [struct.unpack_from("<IIQQQQ", code, start + size * k) for k in range(count)]
    offset, length = next(each[4:] for each in sections if each[1] == 2)  # the table of symbols
    symbols = list(struct.iter_unpack("<IBBHQQ", code[offset : offset + length]))
    defined = [each for each in symbols if each[3]]
    assert len([each for each in defined if each[1] >> 4]) == 2  # its function and environment
    assert len([each for each in defined if not each[1] >> 4]) > 2
