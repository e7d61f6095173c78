"""The law of rules: machine code gives the string that Python gives, or the same error.

Rules are generated, with numbers for which Python has errors or ints of any length. Each example
has a long rule, because compiling takes seconds and an example must be worth it.
"""

from __future__ import annotations

import re
import sys
import traceback
from importlib import import_module
from random import Random

import numpy as np
import pytest

pytest.importorskip("numba")

from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from minerva_bus import MinervaError, World, each, evolve, run
from minerva_bus.grammar.scene import Scene
from minerva_bus.world.context import Frame
from minerva_fast import interpreted

HEAD = """
import math

import numpy as np

from minerva_bus import Cells, EventType, Reals, on, portable
from minerva_fast import *

eStep = EventType("eStep")
TABLE = (1.0, -0.5, 3.0)
SIZE = 3

class Mouse(OnLattice):
    x: Column
    y: Column
    n: Column

class Bird(InField):
    n: Column
    z: Column

@kernel
def shaped(x, n):
    if n % 2 == 0:
        return x * 0.5
    total = 0.0
    for i in range(n % 4):
        total += x - i
    return total

"""

SPACE = """
class Place(Space, symbol="APlace"):
    mice: Reals
    birds: Reals
    grass: Cells
    scent: Reals

    @on("eStep")
    def step(self, step, moment):
        self.run(moment, live, share=0.75, size=4)
"""

RULES = {
    "lattice": "def live(k: int, mice: Mouse, before: Mouse, grass: Cells, scent: Reals, share: float,"
               " size: int, draws: Draws):",
    "field": "def live(k: int, birds: Bird, before: Bird, grass: Cells, scent: Reals, share: float,"
             " size: int, draws: Draws):",
    "cells": "def live(k: int, grass: Cells, before: Cells, mice: Mouse, scent: Reals, share: float,"
             " size: int, draws: Draws, lattice: CellGrid):",
}  # fmt: skip
OWN = {
    "lattice": {
        "real": ["mice.x[k]", "mice.y[k]", "before.x[k]", "before.y[(k + 1) % 9]"],
        "int": ["mice.cell[k]", "grass[mice.cell[k]]", "within(before, before.cell[k], 1)"],
        "do": ["mice.x[k] = $r", "mice.y[k] -= $r", "mice.n[k] = $i",
               "move_to(mice, k, next_cell(mice.lattice, mice.cell[k], draws))",
               "move_to(mice, k, $i % 16)", "remove(mice, k)\nreturn",
               "if $b:\n    mice.x[copy(mice, k)] = $r"],
    },
    "field": {
        "real": ["birds.z[k]", "before.x[k]", "before.z[(k + 1) % 9]"],
        "int": ["near(before, before.x[k], before.y[k], 1.5, k)", "k"],
        "do": ["birds.z[k] = $r", "birds.n[k] = $i", "birds.z[k] *= $r",
               "go_to(birds, k, birds.x[k] + $r, $r)", "go_to(birds, k, 1.0, birds.y[k] - share)",
               "if $b:\n    birds.z[copy(birds, k)] = $r"],
    },
    "cells": {
        "real": ["mice.y[k % 9]", "0.5 * before[k]"],
        "int": ["grass[k]", "before[k]", "before[(k + 5) % 16]", "beside(lattice, k, 1, -1)"],
        "do": ["grass[k] = $i % 100", "grass[k] += $i", "mice.x[k % 9] = $r"],
    },
}  # fmt: skip
REALS = ["0.0", "-0.0", "1.5", "-2.25", "1e-3", "1e300", "u", "v", "share", "TABLE[1]",
         "counts[i % 3]", "scent[k]", "random(draws)", "normal(draws, 0.0, 0.5)",
         "uniform(draws, -1, 1)", "exponential(draws, 2)"]  # fmt: skip
OF_REALS = ["($r + $r)", "($r - $r)", "($r * $r)", "($r + $i)", "($r * $i)", "($r * max($i, $r))",
            "math.sqrt(abs($r if $b else $i))", "(-$r)", "abs($r)",
            "($r / $r)", "($r / (u if u != 0 else 1.0))", "($r // (v if v != 0 else 1.0))",
            "($r % (share if share != 0 else 2.0))", "min($r, $r)", "max($r, $r, $r)",
            "($r if $b else $r)", "math.sqrt(abs($r))", "math.sqrt($r)", "portable.sin($r)",
            "float($i)", "math.exp(min(2.0, $r))", "portable.log(abs($r) + 1.0)", "shaped($r, k)",
            "($r ** 2)", "($i / 7)", "($i / $i)", "portable.hypot($r, $r)", "math.atan2($r, $r)",
            "math.copysign(1.0, $r)"]  # fmt: skip
INTS = ["0", "1", "-7", "i", "k", "size", "SIZE", "(2**40)", "grass[k]", "integers(draws, 5)",
        "len(TABLE)", "int(random(draws) * 9)"]  # fmt: skip
OF_INTS = ["($i + $i)", "($i - $i)", "($i * $i)", "($i & $i)", "($i | $i)", "($i // 3)",
           "($i % -5)", "($i // $i)", "(-$i)", "($i ** 2)", "($i << 3)", "($i >> 2)",
           "($i if $b else $i)", "int(max(-1e9, min(1e9, $r)))", "int($r)",
           "round(max(-1e9, min(1e9, $r)))", "math.floor(max(-1e9, min(1e9, $r)))", "abs($i)",
           "min($i, $i)"]  # fmt: skip
BOOLS = ["True", "i > 2", "chance(draws, 0.4)", "k % 2 == 0", "u < v"]
OF_BOOLS = ["($r < $r)", "($r <= $r)", "($r == $r)", "($i != $r)", "($i < $r)", "($i >= $i)",
            "($b and $b)", "($b or $b)", "(not $b)", "($r < u < $r)"]  # fmt: skip
DO = ["u += $r", "u = max(-1e6, min(1e6, $r))", "v = max(-1e6, min(1e6, $r))", "i = $i % 100",
      "i += $i % 50", "u, v = v, u", "counts[$i % 3] += $r", "scent[$i % 16] += $r",
      "scent[k] = max(-1e6, min(1e6, $r))", "assert i < 5000", "grass[$i % 16] = $i % 30"]  # fmt: skip
HEADS = ["if $b:", "if $b:", "for i in range(3):", "for each in TABLE:",
         "while i < 5 and turns < 9 and $b:"]  # fmt: skip


class Writer:
    """Writes random rules; a strategy of Hypothesis would run out of its choices."""

    def __init__(self, seed):
        self.random = Random(seed)
        self.kind = self.random.choice(sorted(RULES))
        own = OWN[self.kind]
        self.leaves = {"r": REALS + own["real"], "i": INTS + own["int"], "b": BOOLS}
        self.branches = {"r": OF_REALS, "i": OF_INTS, "b": OF_BOOLS}
        # A cell that other activations change is read from `before`.
        other = ("grass[$i", "grass[k]") if self.kind == "cells" else ()
        self.do = [each for each in [*DO, *own["do"]] if not each.startswith(other[:1])]

    def filled(self, form, depth):
        return re.sub(r"\$([rib])", lambda match: self.value(match[1], depth - 1), form)

    def value(self, kind, depth):
        """A leaf, or the text of an expression with smaller parts."""
        if depth <= 0 or self.random.random() < 0.3:
            return self.random.choice(self.leaves[kind])
        return self.filled(self.random.choice(self.branches[kind]), depth)

    def statement(self, depth):
        if not depth or self.random.random() < 0.6:
            return self.filled(self.random.choice(self.do), 2).split("\n")
        head = self.filled(self.random.choice(HEADS), 2)
        lines = [head, *self.block(depth - 1)]
        if head.startswith("while"):  # which ends, even if its block assigns to i
            lines += ["    i += 1", "    turns += 1"]
        if head.startswith("if") and self.random.random() < 0.5:
            lines += ["else:", *self.block(depth - 1)]
        return lines

    def block(self, depth):
        inner = [line for _ in range(self.random.randint(1, 3)) for line in self.statement(depth)]
        return ["    " + line for line in inner]

    def module(self):
        """The text of a module with a rule and its space."""
        order = self.random.choice(["SIMULTANEOUS", "ORDERED", "SHUFFLED"])
        body = [line for _ in range(self.random.randint(3, 6)) for line in self.statement(2)]
        # Not each row reaches what fails.
        start = ["i = turns = 0", "u = 1.0", "v = share", "counts = [0.0] * 3"]
        start += [f"if k % {self.random.randint(1, 4)} == 0:", "    return"]
        rule = [f"@rule({order}, births=9)", RULES[self.kind]]
        lines = "\n".join(["    " + line for line in [*start, *body]])
        return HEAD + "\n".join(rule) + "\n" + lines + "\n\n" + SPACE


def outcome(scene, module, frames):
    """The strings of some frames, and the text of an error with the line of the rule."""
    scenes = []
    for number in range(frames):
        try:
            evolved = evolve(scene, [module.eStep()], [module.Place], Frame(number, seed=5))
        except MinervaError as error:
            cause = error.__cause__ or error
            lines = traceback.extract_tb(cause.__traceback__)
            own = [each.lineno for each in lines if each.filename == module.__file__]
            return scenes, (str(error), str(cause), own[1:2])
        scene = evolved.scene
        scenes.append(scene)
    return scenes, None


def places(module, seed):
    """Two spaces, which are also evolved apart, as by two hosts."""
    rng = np.random.default_rng(seed)
    for name in ("a", "b"):
        x, y, n = np.round(rng.normal(size=(3, 9)), 1)
        yield module.Place(
            name, width=4, height=4, periodic=bool(seed % 2), births=30,
            mice=module.Mouse.many(9, cell=rng.integers(0, 16, 9), x=x, y=y, n=n),
            birds=module.Bird.many(9, first=9, x=x % 4, y=y % 4, n=n, z=y),
            grass=rng.integers(0, 9, (4, 4)).astype(np.int16), scent=rng.normal(size=(4, 4)),
        ).string  # fmt: skip


def check(seed, folder):
    """Compare a generated rule as machine code and as Python for three frames."""
    (folder / "law_rules.py").write_text(Writer(seed).module(), encoding="utf-8")
    sys.path.insert(0, str(folder))
    try:
        sys.modules.pop("law_rules", None)
        module = import_module("law_rules")
    finally:
        sys.path.remove(str(folder))
    north, south = places(module, seed)
    both = Scene((*north.pieces, *south.pieces))
    with interpreted():
        expected, problem = outcome(both, module, 3)
    compiled, same_problem = outcome(both, module, 3)
    assert same_problem == problem
    assert [str(each) for each in compiled] == [str(each) for each in expected]
    assert [each.digest for each in compiled] == [each.digest for each in expected]
    apart = [outcome(part, module, 3)[0] for part in (north, south)]
    for whole, *parts in zip(expected, *apart, strict=False):
        nodes = tuple([node for part in parts for node in part.nodes])
        assert str(whole) == str(Scene(nodes))
    if problem is None:
        hosts = {"north": [module.Place], "south": [module.Place]}
        world = World(both, agents=hosts, services=[each(module.eStep)], name="law", seed=5)
        assert run(world, frames=3).digest == expected[-1].digest.hex()
    return problem


@pytest.mark.timeout(600)  # compiling takes seconds
@settings(max_examples=2, phases=(Phase.explicit, Phase.generate))  # shrinking takes minutes
@given(seed=st.integers(0, 2**32))
def test_a_rule_gives_what_it_gives_as_python(seed, tmp_path_factory):
    check(seed, tmp_path_factory.mktemp("law"))


@pytest.mark.slow
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("seed", range(60))
def test_many_rules_give_what_they_give_as_python(seed, tmp_path):
    check(seed, tmp_path)
