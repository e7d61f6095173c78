"""Rules that cannot be compiled: the line, the place in it, and what to write instead."""

import importlib.util

import pytest
from space_worlds import Sheep, meadow, moment

from minerva_bus.errors import MisuseError
from minerva_bus.world.class_declaration import NotCompilable
from minerva_fast import ORDERED, interpreted, rule

HEAD = """
import random as dice
import time
from random import randint

import numpy as np

from minerva_bus import Cells
from minerva_fast import ORDERED, SIMULTANEOUS, Draws, kernel, normal, rule
from space_worlds import Sheep


def plain(x):
    return x


@kernel
def listed(x):
    return [each for each in range(x)]


@kernel
def again(x):
    return again(x)


class Limits:
    MOST = 3


LISTED = [1, 2]
SHORT = np.zeros(3, np.int16)


@kernel
def leap(animals, row):
    animals.cell[row] = 0


"""

# What the rule does, where the marker stands, what is refused, and the alternative.
REFUSED = {
    "try": ("try:\n    pass\nexcept ValueError:\n    pass", "try:", "try", "test the condition"),
    "dict": ("x = {1: 2}", "{1: 2}", "a dict", "attributes"),
    "comprehension": (
        "x = [k for k in (1, 2)]",
        "[k for k in (1, 2)]",
        "comprehension",
        "for loop",
    ),
    "text": ("sheep.energy[i] = 'fat'", "'fat'", "a text", "use numbers"),
    "f-string": ("x = f'{i}'", "f'{i}'", "an f-string", "constant texts"),
    "infinity as text": ("best = float('inf')", "float('inf')", "number in a text", "math.inf"),
    "reversed": (
        "for k in reversed(range(3)): pass",
        "reversed(range(3))",
        "reversed",
        "range(len",
    ),
    "name of a table": (
        "sheep.enrgy[i] = 1",
        "sheep.enrgy",
        "did you mean 'energy'",
        "enrgy: Column",
    ),
    "builtin": ("x = isinstance(i, int)", "isinstance(i, int)", "isinstance", "types"),
    "in a kernel": ("listed(3)", "[each for each in range(x)]", "comprehension", "for loop"),
    "arguments": (
        "x = normal(draws, 1, 2, 3)",
        "normal(draws, 1, 2, 3)",
        "too many positional arguments",
        "normal(draws,",
    ),
    "numpy's random numbers": ("x = np.random.rand()", "np.random.rand()", "rand", "draws"),
    "Python's random numbers": ("x = dice.random()", "dice.random()", "dice.random", "draws"),
    "a name of these": ("x = randint(1, 6)", "randint(1, 6)", "randint", "draws"),
    "clock": ("x = time.perf_counter()", "time.perf_counter()", "perf_counter", "moment.time"),
    "memory": ("x = np.empty(3)", "np.empty(3)", "np.empty", "[0.0] * 4"),
    "method of draws": ("x = draws.integers(6)", "draws.integers", "no methods", "integers(draws"),
    "cell": ("sheep.cell[i] = 0", "sheep.cell[i]", "sheep.cell", "move_to(sheep, i, cell)"),
    "cell by another name": ("c = sheep.cell\nc[i] += 1", "c[i]", "to c", "move_to(sheep"),
    "cell in a kernel": ("leap(sheep, i)", "animals.cell[row]", "animals.cell", "move_to(sheep"),
    "list of the search": ("sheep.nearby[0] = 1", "sheep.nearby[0]", "sheep.nearby", "columns"),
    "row": ("sheep[i].energy = 1", "sheep", "sheep as a whole", "sheep.energy[i]"),
    "rows": ("for k in sheep:\n    pass", "sheep", "sheep as a whole", "sheep.energy[k]"),
    "number of rows": ("x = len(sheep)", "sheep", "sheep as a whole", "sheep.energy"),
    "two indices": ("sheep.energy[0, 1] = 1", "sheep.energy[0, 1]", "not one number", "width"),
    "itself": ("x = again(3)", "again(x)", "calls itself", "write a loop"),
    "unpacking": ("x, *y = (1, 2, 3)", "*y", "an argument with *", "each argument"),
    "list of the module": (
        "x = LISTED[0]",
        "LISTED[0]",
        "an item of this value",
        "a constant tuple",
    ),
    "short items": ("x = SHORT[0]", "SHORT", "a constant of int16", "int64"),
    "numpy's exp": ("x = np.exp(1.0)", "np.exp(1.0)", "np.exp", "use portable.exp"),
    "number of numpy": ("x = np.int32(i)", "np.int32(i)", "np.int32", "write int(...)"),
    "digits": ("x = round(1.25, 1)", "round(1.25, 1)", "digits", "round(100 * x) / 100"),
    "least of a tuple": ("x = min((1, 2))", "(1, 2)", "a tuple here", "a variable for each"),
    "large int": ("x = i + 9223372036854775808", "9223372036854775808", "64 bits", "real number"),
    "item of draws": ("x = draws[0]", "draws[0]", "random stream", "random(draws)"),
    "divmod": ("x = divmod(i, 2)", "divmod(i, 2)", "divmod", "a // b"),
    "branch": ("if i:\n    x = 1\nsheep.energy[i] = x", "x", "x may have no value", "assign x"),
    "loop": ("for k in range(i):\n    x = k\nx += 1", "x", "x may have no value", "assign x"),
    "loop variable": ("for k in range(i):\n    pass\nx = k", "k", "k may have no", "assign k"),
    "break": (
        "while True:\n    if i:\n        break\n    x = 1\nsheep.energy[i] = x",
        "x",
        "x may have no value",
        "assign x",
    ),
}
VALUES = {
    "both branches": "if i:\n    x = 1\nelse:\n    x = 2\nsheep.energy[i] = x",
    "a branch that ends": "if i:\n    return\nelse:\n    x = 2\nsheep.energy[i] = x",
    "an endless loop": "while True:\n    x = 2\n    if i < 9:\n        break\nsheep.energy[i] = x",
    "a loop in its body": "for k in range(3):\n    x = k\n    sheep.energy[i] = x",
    "a square": "sheep.energy[i] = sheep.energy[i] ** 2 + 10 ** 3",
    "a constant of numpy": "sheep.energy[i] = np.pi",
}


def declared(tmp_path, body):
    """The rule with this body, of a module of its own."""
    lines = "".join(f"    {line}\n" for line in body.splitlines())
    path = tmp_path / "ruled.py"
    head = f"{HEAD}@rule(ORDERED)\ndef live(i: int, sheep: Sheep, draws: Draws):\n"
    path.write_text(head + lines)
    return imported(path)


def imported(path):
    spec = importlib.util.spec_from_file_location("ruled", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.live


@pytest.mark.parametrize("case", REFUSED)
def test_a_rule_is_checked_when_it_is_declared(tmp_path, case):
    body, marked, what, instead = REFUSED[case]
    with pytest.raises(NotCompilable) as error:
        declared(tmp_path, body)
    first, place, code, marker, advice = str(error.value).splitlines()
    assert "cannot be compiled: " in first
    assert what in first
    number = int(place.split(":")[1].split(",")[0])
    text = (tmp_path / "ruled.py").read_text().splitlines()[number - 1]
    assert code.strip() == text.strip()
    assert code[marker.index("^") : marker.rindex("^") + 1] == marked
    assert advice.startswith("  instead: ")
    assert instead in advice


@pytest.mark.parametrize("case", VALUES)
def test_what_has_a_value_on_each_path_is_possible(tmp_path, case):
    assert declared(tmp_path, VALUES[case]).name == "live"


def test_a_kernel_below_its_rule_is_checked_before_it_runs(tmp_path):
    path = tmp_path / "ruled.py"
    head = "@rule(ORDERED)\ndef live(i: int, sheep: Sheep):\n    roll(sheep, i)\n\n\n"
    body = "@kernel\ndef roll(animals, row):\n    animals.energy[row] = dice.random()\n"
    path.write_text(HEAD + head + body)
    live = imported(path)
    with pytest.raises(NotCompilable, match="the function dice"):
        live.prepare()
    with interpreted(), pytest.raises(NotCompilable, match="the function dice"):
        meadow().run(moment(), live)


@pytest.mark.parametrize("body", ["before[cell] = 1", "old = before\n    old[cell] = 1"])
def test_the_state_before_a_rule_cannot_be_changed(tmp_path, body):
    path = tmp_path / "ruled.py"
    head = "@rule(SIMULTANEOUS)\ndef live(cell: int, grass: Cells, before: Cells):\n    "
    path.write_text(HEAD + head + body)
    with pytest.raises(NotCompilable, match="change the subject"):
        imported(path)


def test_a_rule_needs_its_order_and_types():
    with pytest.raises(MisuseError, match=r"write @rule\(SHUFFLED\)"):
        rule(lambda i, sheep: None)
    with pytest.raises(MisuseError, match="moment has no type"):

        @rule(ORDERED)
        def live(i: int, sheep: Sheep, moment):
            pass


def test_what_only_the_compiler_notices_has_its_line(tmp_path):
    live = declared(tmp_path, "x = 1\nsheep.energy[i] = wether")
    with pytest.raises(NotCompilable, match="wether is not defined when the rule is made") as error:
        meadow().run(moment(), live)
    assert str(error.value).splitlines()[2].strip() == "sheep.energy[i] = wether"


def test_a_rule_without_source_is_not_checked():
    code = compile("def live(i: int, sheep: Sheep):\n    x = {1: 2}\n", "<console>", "exec")
    scope = {"Sheep": Sheep}
    exec(code, scope)
    with pytest.warns(UserWarning, match="source is not available .* it runs as Python"):
        assert rule(ORDERED)(scope["live"]).as_python


def test_documentation_messages_of_errors_and_tuples_are_possible(tmp_path):
    lines = [
        '"""Set energies."""',
        'assert i >= 0, "a row"',
        "if i < 0:",
        '    raise ValueError("impossible")',
        "low, high = (1.0, 2.0)",
        "sheep.energy[i] = low + high",
    ]
    space = meadow(sheep=2, wolves=0)
    space.run(moment(), declared(tmp_path, "\n".join(lines)))
    assert Sheep.read(space.sheep).energy.tolist() == [3, 3]
