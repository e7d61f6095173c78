"""Nodes that are read together are those that would be read one by one, and so are the errors."""

import math

import pytest

from minerva_bus import Agent, Primitive, Transformation, Vocabulary
from minerva_bus.errors import MinervaError
from minerva_bus.wire import strings_codec
from minerva_bus.wire.plain import pack, unpack
from minerva_bus.wire.strings_codec import RUN


class Fox(Agent, symbol="AFox"):
    """An agent with an attribute of each plain type."""

    x: float = 0.0
    name: str = ""
    age: int = 0
    tame: bool = False


class Stone(Agent, symbol="AStone"):
    """An agent without attributes."""


VOCABULARY = Vocabulary.of(
    Fox, Stone, Primitive("PDot", x=float), Transformation("TMove", x=float)
)  # fmt: skip
FOX, DOT, MOVE = ["AFox", "f", [1.5, "x", 3, True], 0], ["PDot", [1.0]], ["TMove", [1.0], 0]
ODD = {
    "values": [1, "x", 3, True],
    "infinity": [math.inf, "x", 3, True],
    "nan": [math.nan, "x", 3, True],
    "large integer": [1.0, "x", 1 << 63, True],
    "number as truth": [1.0, "x", 3, 1],
    "truth as number": [1.0, "x", True, True],
    "other letters": [1.0, "é", 3, True],
    "nil": [1.0, None, 3, True],
    "list": [1.0, ["x"], 3, True],
    "few values": [1.0, "x", 3],
    "no list": 7,
}  # fmt: skip
FOXES = {
    "alike": [],
    **{name: [[2, plain]] for name, plain in ODD.items()},
    "no id": [[1, ""]], "wrong id": [[1, "a b"]], "line": [[1, "f1\nf2"]], "number": [[1, 7]],
    "same id": [[1, "f0"]], "unknown": [[0, "ADog"]], "no text": [[0, ["AFox"]]],
    "nil count": [[3, None]], "real count": [[3, 0.0]], "false": [[3, False]], "scope": [[3, 2]],
}  # fmt: skip


def foxes(place, changes):
    run = [[FOX[0], f"f{n}", *FOX[2:]] for n in range(2 * RUN)]
    for item, value in changes:
        run[place] = [*run[place][:item], value, *run[place][item + 1 :]]
    return run


STRINGS = {
    **{f"one, {what}": foxes(0, changes)[:1] for what, changes in FOXES.items()},
    **{
        f"{what} at {place}": foxes(place, changes)
        for what, changes in FOXES.items()
        for place in (0, 1, RUN, 2 * RUN - 1)
    },
    "figures": [DOT] * RUN, "transformations": [MOVE] * RUN, "cells": [["PDot", [math.nan]]] * RUN,
    "chains": [["TMove", [1.0], 1], DOT] * RUN, "no values": [["AStone", "s", None, 0]] * RUN,
    "a short run": [DOT] * (RUN - 1), "numbers": [[5, [], 0]] * RUN, "nothing": [[]] * RUN,
    "long figures": [["PDot", [1.0], 0]] * RUN, "short agents": [["AFox", "f", 0]] * RUN,
    "known ids": [*foxes(0, []), MOVE, *foxes(0, [])], "inner": [["TMove", [1.0], RUN], *[DOT] * RUN],
}  # fmt: skip


def result(plain, count):
    try:
        return strings_codec.Reader(VOCABULARY).scene(unpack(pack([count, *plain])))
    except MinervaError as error:
        return f"{type(error).__name__}: {error}"


@pytest.mark.parametrize("what", STRINGS)
def test_a_run_is_read_like_its_nodes(what, monkeypatch):
    plain = STRINGS[what]
    counts = [len(plain), len(plain) - 1, len(plain) + 1, 1]
    together = [result(plain, count) for count in counts]
    monkeypatch.setattr(strings_codec, "end_of_run", lambda flat, begin, most: begin)
    assert together == [result(plain, count) for count in counts]
    if what in ("alike at 0", "figures", "transformations", "inner"):
        assert any(not isinstance(each, str) for each in together)


def test_long_runs_are_read_together(monkeypatch):
    monkeypatch.setattr(strings_codec.Reader, "_node", lambda *_: pytest.fail("read alone"))
    for plain in (foxes(0, []), [DOT] * RUN, [MOVE] * RUN):
        assert len(result(plain, len(plain)).pieces) == len(plain)
