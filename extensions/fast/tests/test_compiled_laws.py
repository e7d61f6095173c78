"""The law of compiled methods: any method gives what it gives agent by agent, or the same error.

Methods, events and populations are generated. Each example has a long method, because compiling
takes seconds and an example must be worth it.
"""

from __future__ import annotations

import re
import sys
from importlib import import_module
from random import Random

import numpy as np
import pytest

pytest.importorskip("numba")

from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from twins import compiled_form, same

from minerva_bus import MinervaError, World, run
from minerva_bus.grammar.ids import Ids

HEAD = """
import math
from typing import Literal
from minerva_bus import EMPTY, Agent, EventType, Generator, on, portable

eDay = EventType("eDay", a=float, k=int, w=bool, t=str)
eCall = EventType("eCall", a=float, k=int, t=str)
TABLE = (1.0, -0.5, 3.0)
SIZE = 3
STEPS = ((0, 1), (1, 0), (-1, -2))

class Days(Generator, events=("eDay",)):
    def generate(self, tick):
        yield eDay(a=0.5 * tick.number, k=tick.number, w=tick.number == 1, t="b")

def shaped(x, n):
    if n % 2 == 0:
        return x * 0.5
    total = 0.0
    for i in range(n % 4):
        total += x - i
    return total

class Kind(Agent, symbol="AKind"):
    x: float = 0.0
    y: float = 1.0
    n: int = 0
    c: bool = False
    s: Literal["a", "b", "c"] = "a"
    friend: str = "a1"
    births: int = 0

    def mean(self):
        return (self.x + self.y) / 2

    @on("eCall")
    def answer(self, call, moment):
        self.x = max(-9.0, min(9.0, self.x + call.a))
        self.friend = call.sender

    @on("eDay")
    def live(self, day, moment):
        i = dx = dy = 0
        u = 1.0
        v = self.x
        counts = [0.0] * 3
"""


class Writer:
    """Writes random methods; a strategy of Hypothesis would run out of its choices."""

    def __init__(self, seed):
        self.random = Random(seed)

    def chosen(self, depth, leaves, branches):
        """A leaf, or the text of a branch with smaller parts."""
        if not depth or self.random.random() < 0.3:
            return self.random.choice(leaves)
        form = self.random.choice(branches)
        parts = {"r": self.real, "i": self.int, "b": self.bool}
        return re.sub(r"\$([rib])", lambda match: parts[match[1]](depth - 1), form)

    def real(self, depth):
        return self.chosen(depth, REALS, OF_REALS)

    def int(self, depth):
        return self.chosen(depth, INTS, OF_INTS)

    def bool(self, depth):
        return self.chosen(depth, BOOLS, OF_BOOLS)

    def simple(self):
        form = self.random.choice(SIMPLE)
        parts = {"r": self.real, "i": self.int, "b": self.bool}
        return re.sub(r"\$([rib])", lambda match: parts[match[1]](3), form)

    def statement(self, depth):
        if not depth or self.random.random() < 0.6:
            return [self.simple()]
        lines = [self.random.choice(HEADS).replace("$b", self.bool(2)), *self.block(depth - 1)]
        if lines[0].startswith("for") and self.random.random() < 0.5:
            jump = f"    if {self.bool(2)}: {self.random.choice(JUMPS)}"
            lines.insert(self.random.choice([1, len(lines)]), jump)
        if lines[0].startswith("if") and self.random.random() < 0.5:
            lines += ["else:", *self.block(depth - 1)]
        return lines

    def block(self, depth):
        inner = [line for _ in range(self.random.randint(1, 3)) for line in self.statement(depth)]
        return ["    " + line for line in inner]

    def method(self):
        lines = [line for _ in range(self.random.randint(6, 12)) for line in self.statement(3)]
        return ["w = 0.0", *lines, *self.random.choice(ENDS)]


REALS = ["0.0", "-0.0", "1.5", "-2.25", "1e-3", "self.x", "self.y", "u", "v", "w", "day.a", "moment.dt",
         "moment.time", "TABLE[1]", "counts[i % 3]", "self.mean()", "moment.chance.random()",
         "moment.chance.normal(0, 0.5)", "moment.chance.uniform(-1, 1)",
         "moment.chance.exponential(2)"]  # fmt: skip
OF_REALS = ["($r + $r)", "($r - $r)", "($r * $r)", "($r + $i)", "($r * $i)", "($r * max($i, $r))",
            "math.sqrt(abs($r if $b else $i))", "(-$r)", "abs($r)",
            "($r / (u if u != 0 else 1.0))", "($r // (v if v != 0 else 1.0))",
            "($r % (self.y if self.y != 0 else 2.0))", "min($r, $r)", "max($r, $r)",
            "($r if $b else $r)", "math.sqrt(abs($r))", "portable.sin($r)", "float($i)",
            "portable.exp(min(2.0, $r))", "shaped($r, self.n)", "shaped($r, i)", "($r ** 2)",
            "($i / 7)", "portable.hypot($r, $r)", "math.atan2($r, $r)"]  # fmt: skip
INTS = ["0", "1", "-7", "self.n", "i", "dx", "dy", "day.k", "moment.number", "SIZE", "self.births",
        "2**40", "moment.chance.integers(5)", "len(TABLE)"]  # fmt: skip
OF_INTS = ["($i + $i)", "($i - $i)", "($i * $i)", "($i & $i)", "($i | $i)", "($i // 3)", "($i % -5)",
           "($i if $b else $i)", "int(max(-1e9, min(1e9, $r)))", "round(max(-1e9, min(1e9, $r)))",
           "math.floor(max(-1e9, min(1e9, $r)))", "abs($i)"]  # fmt: skip
BOOLS = ["self.c", "day.w", "True", "self.s == 'a'", "self.s in ('b', 'c')", "day.t == self.s",
         "self.id == self.friend", "moment.chance.chance(0.4)"]  # fmt: skip
OF_BOOLS = ["($r < $r)", "($r <= $r)", "($r == $r)", "($i != $r)", "($i < $r)", "($i >= $i)",
            "($b and $b)", "($b or $b)", "(not $b)"]  # fmt: skip
SIMPLE = ["w += $r", "w = max(-1e6, min(1e6, w - $r))", "self.x = max(-1e6, min(1e6, $r))",
          "self.y = max(-1e6, min(1e6, $r))", "u += $r",
          "u = max(-1e6, min(1e6, $r))", "v = max(-1e6, min(1e6, $r))", "self.x -= $r",
          "self.n = $i % 1000", "i = $i % 100", "self.c = $b", "self.s = 'b'", "u, v = v, u",
          "self.s = 'c' if $b else 'a'", "self.friend = self.id", "self.y = 0.0 if $b else v",
          "counts[$i % 3] += max(-1e3, min(1e3, $r))", "assert self.n < 990", "assert u < 1e9",
          "moment.emit(eCall(a=max(-1e9, min(1e9, $r)), k=$i % 9, t=self.s, receivers=[self.friend]))",
          "if $b and self.x > 5: return EMPTY"]  # fmt: skip
HEADS = ["if $b:", "if $b:", "if $b:", "for i in range(3):", "for each in TABLE:", "for dx in (-1, 0, 1):",
         "for dx, dy in ((0, 1), (1, 0)):", "for dx, dy in STEPS:", "for u in counts:"]  # fmt: skip
JUMPS = ["break", "continue", "return None", "return EMPTY"]
ENDS = [
    ["return self.string + self.child(x=u if abs(u) < 1e9 else 0.0, s=self.s) if self.c else None"],
    ["return self.string + self.child(n=i) + self.child(x=v if abs(v) < 1e9 else 1.0)"],
    ["return EMPTY if self.n % 7 == 3 else self.string"],
    ["return self.child(y=2.0) if self.n % 5 == 1 else None"],
]  # fmt: skip


def events(module, rng, count):
    """Events of a frame: for all, for one agent, and a batch with several for some agents."""
    day = module.eDay(a=rng.normal(), k=int(rng.integers(9)), w=bool(rng.random() < 0.5), t="b")
    day_event = module.eDay(a=0.25, k=2, w=True, t="a", receivers=["a3", "a7"], condition="x > 0")
    to = Ids.numbered("a", rng.integers(0, count, 20))
    hits = module.eDay(a=rng.normal(size=20), k=3, w=True, t="c", receivers=to)
    call = module.eCall(a=0.5, k=1, t="a", receivers=["a2"], sender="a5")
    chosen = [day, day_event, hits, call]
    return [chosen[i] for i in sorted(rng.permutation(4)[: rng.integers(1, 5)].tolist())]


@pytest.mark.timeout(600)  # compiling takes seconds
@settings(max_examples=2, phases=(Phase.explicit, Phase.generate))  # shrinking takes minutes
@given(seed=st.integers(0, 2**32))
def test_a_compiled_method_gives_what_it_gives_agent_by_agent(seed, tmp_path_factory):
    check(seed, tmp_path_factory.mktemp("law"))


def check(seed, folder):
    """Compare a generated method with its compiled form for three frames."""
    method = Writer(seed).method()
    text = HEAD + "\n".join(" " * 8 + line for line in method) + "\n"
    (folder / "law_world.py").write_text(text, encoding="utf-8")
    sys.path.insert(0, str(folder))
    try:
        sys.modules.pop("law_world", None)
        module = import_module("law_world")
    finally:
        sys.path.remove(str(folder))
    rng = np.random.default_rng(seed)
    count = int(rng.integers(2, 70))
    x = np.round(rng.normal(size=count), 1)
    numbers = rng.integers(0, 20, count)
    scene = module.Kind.many("a", count, x=x, n=numbers)
    frames = [events(module, rng, count) for _ in range(3)]
    same(module.Kind, scene, frames, parts=1 + seed % 3)
    compiled = [compiled_form(module.Kind)]
    hosts = {"north": compiled, "south": compiled}
    assert ran(scene, module, {"host": [module.Kind]}) == ran(scene, module, hosts)


def ran(scene, module, hosts):
    """The digest of a run in one process with these hosts, or the text of its error."""
    world = World(scene, agents=hosts, services=[module.Days], name="law", seed=7)
    try:
        return run(world, frames=3).digest
    except MinervaError as error:
        # Hosts fail at the same agent, but one of them has another name.
        return str(error).partition(": ")[2] or str(error)
