"""What cannot be compiled is an error when the class is made: where, what, and what instead."""

from __future__ import annotations

import sys
from importlib import import_module

import pytest

from minerva_bus.user_code import described
from minerva_bus.world.class_declaration import NotCompilable

HEAD = """
import math
import numpy as np
from functools import wraps
from minerva_bus import EMPTY, Agent, EventType, Scene, on

eDay = EventType("eDay", grass=float, word=str, parts=tuple[float, ...])
eCall = EventType("eCall", loud=float)
TABLE = {"a": 1}
STARTS = (1.0, 2.0)

def twice(x):
    return 2 * x

def again(n):
    return again(n - 1) if n > 0 else 0

def silent(x):
    if x > 0:
        return x

class Sheep(Agent, symbol="ASheep"):
    x: float = 0.0
    n: int = 0
    calm: bool = True
    name: str = ""
    births: int = 0

    def grow(self):
        self.x += 1
        return self.x

    @on("eDay", compiled=True)
    def live(self, day, moment):
"""

# The method, the part that is marked, a part of what is wrong, and of what to write instead.
REFUSED = {
    "list comprehension": ("self.x = [e for e in STARTS][0]", "[e for e in STARTS]", "item", ""),
    "generator": ("self.x = sum(e for e in STARTS)", "sum(e for", "function sum", "for loop"),
    "dict": ("d = {}", "{}", "a dict", "attributes"),
    "set": ("d = {1, 2}", "{1, 2}", "a set", "=="),
    "lambda": ("f = lambda x: x", "lambda x: x", "a lambda", "top of the module"),
    "f-string": ("self.name = f'{self.n}'", "f'{self.n}'", "an f-string", "constant texts"),
    "walrus": ("if (y := self.x) > 1: pass", "y := self.x", "within an expression", "statement"),
    "try": ("try:\n    self.x = 1 / self.x\nexcept ZeroDivisionError:\n    pass", "try:", "try", "if"),
    "with": ("with open('f'): pass", "with open('f'): pass", "with", "resources"),
    "import": ("import math", "import math", "an import", "top of the module"),
    "inner function": ("def f(): return 1", "def f(): return 1", "a function within", "top"),
    "global": ("global TABLE", "global TABLE", "global", "attribute"),
    "del": ("del self.x", "del self.x", "del", "0 or False"),
    "match": ("match self.n:\n    case 1: pass", "match self.n:", "match", "elif"),
    "print": ("print(self.x)", "print(self.x)", "function print", "emit"),
    "module object": ("self.x = TABLE", "TABLE", "is a dict", "constants"),
    "item of dict": ("self.x = TABLE['a']", "TABLE['a']", "an item", "constant tuple"),
    "unknown name": ("self.x = WIDTH", "WIDTH", "WIDTH is not defined", "above the class"),
    "unknown attribute": ("self.y = 1.0", "self.y", "no attribute y", "declare y"),
    "temporary attribute": ("self._y = 1.0", "self._y", "temporary attribute", "local variable"),
    "unset variable": (
        "if self.calm:\n    y = 1.0\nself.x = y", "y", "y may have no value", "before the branch",
    ),
    "unset after loop": (
        "for i in range(self.n):\n    pass\nself.n = i", "i", "i may have no value", "before",
    ),
    "two types": ("y = 1\ny = self.name", "y", "a text here and an int in line", "one type"),
    "int or real": ("y = 0\nif self.calm:\n    y = 0.5", "y", "y is a real number here and an int in",
                    "0.0 for 0"),
    "sum of reals from an int": ("y = 0\ny += self.x", "y", "a real number here and an int in line",
                                 "0.0 for 0"),
    "int as an attribute": ("self.x = 0", "self.x", "an int in self.x, a real", "0.0 for 0"),
    "least of int and real": ("self.x = min(1, self.x)", "self.x", "real in another in self.x", "0.0"),
    "choice of int and real": ("y = 0 if self.calm else self.x", "y", "an int in one case", "0.0 for 0"),
    "negative of a choice": ("self.x = -max(0, self.x)", "-max(0", "an int in one case", "0.0 for 0"),
    "product of a choice": ("self.x = max(0, self.x) * 2", "max(0", "an int in one case", "0.0 for 0"),
    "list of ints and reals": ("y = [0, 0.5]", "y", "an int in one case", "0.0 for 0"),
    "tuple of ints and reals": ("for y in (0, 0.5):\n    pass", "(0, 0.5)", "an int in one", "0.0"),
    "int in a list of reals": ("y = [0.5] * 3\ny[0] = 1", "y[0]", "holds items of one type", "0.0"),
    "bits of a real": ("y = self.x & 1", "self.x & 1", "bits of a real", "int(...)"),
    "else of a loop": ("for i in range(3):\n    y = i\nelse:\n    y = 1", "for i", "`else` of a loop",
                       "a bool variable"),
    "newborns in a variable": ("y = EMPTY\ny += self.child()", "EMPTY", "EMPTY is a Scene", "return self.string"),
    "several receivers": ("moment.emit(eCall(1.0, receivers=['a', 'b']))", "['a', 'b']", "or several",
                          "an event for each"),
    "array": ("y = np.zeros(3)", "np.zeros(3)", "the function np.zeros", "[0.0] * 4"),
    "real in an int": ("self.n = self.x", "self.n", "n is declared as int", "int(...)"),
    "number in a bool": ("self.calm = self.n", "self.calm", "calm is declared as bool", "compare"),
    "order of texts": ("self.calm = self.name < 'b'", "self.name < 'b'", "order of texts", "=="),
    "text plus text": ("self.name = self.name + 'b'", "self.name", "arithmetic with a text", "=="),
    "text and number": ("self.calm = self.name == 1", "self.name == 1", "compared with", "equal"),
    "bits of bools": ("self.calm &= self.x > 0", "self.calm &=", "bits of bools", "and"),
    "greatest bool": ("self.n = max(self.calm, 0)", "max(self.calm, 0)", "max of bools", "and"),
    "is": ("self.calm = self.calm is True", "self.calm is True", "`is`", "=="),
    "power": ("self.n = 2 ** self.n", "2 ** self.n", "a power of ints", "float(n)"),
    "round digits": ("self.x = round(self.x, 2)", "round(self.x, 2)", "digits", "100"),
    "numpy draw": ("self.x = moment.random.normal()", "moment.random", "moment.random",
                   "moment.chance"),
    "no such draw": ("self.x = moment.chance.gauss()", "moment.chance.gauss()", "no gauss", ""),
    "choice": ("self.x = moment.chance.choice(STARTS)", "moment.chance.choice", "no choice", "an index"),
    "a draw of numpy": ("self.x = np.random.normal()", "np.random.normal", "normal", "write moment.chance.normal(...)"),
    "an int of numpy": ("self.n = np.random.randint(3)", "np.random.randint", "randint", "moment.chance.integers"),
    "alias of chance": ("d = moment.chance", "moment.chance", "as a value", "in each draw"),
    "order of draws": (
        "self.x = moment.chance.normal(deviation=moment.chance.random(), mean=1.0)",
        "moment.chance.normal", "another order", "mean, deviation",
    ),
    "two values of a draw": ("self.x = moment.chance.normal(1.0, mean=2.0)",
                             "moment.chance.normal", "multiple values for argument 'mean'", ""),
    "two values of a datum": ("moment.emit(eCall(1.0, loud=2.0))", "eCall(1.0, loud=2.0)",
                              "two values of loud", "leave out"),
    "infinity as text": ("self.x = float('inf')", "float('inf')", "number in a text", "math.inf"),
    "numpy sqrt": ("self.x = np.sqrt(2.0)", "np.sqrt(2.0)", "function np.sqrt", "math.sqrt"),
    "numpy abs": ("self.x = np.abs(2.0)", "np.abs(2.0)", "function np.abs", "use abs"),
    "numpy exp": ("self.x = np.exp(2.0)", "np.exp(2.0)", "function np.exp", "portable.exp"),
    "clip": ("self.x = np.clip(2.0, 0, 1)", "np.clip(2.0, 0, 1)", "np.clip", "max(low"),
    "reversed": ("for x in reversed(STARTS): pass", "reversed(STARTS)", "reversed", "range(len"),
    "in of a dict": ("self.calm = self.name in TABLE", "self.name in TABLE", "`in`", "values"),
    "missing datum": ("self.x = day.grsas", "day.grsas", "eDay has no grsas", "grass"),
    "list as datum": ("self.x = day.parts[0]", "day.parts", "", ""),
    "event as a value": ("e = eCall(loud=1.0)", "eCall(loud=1.0)", "an event as a value", "emit"),
    "stored event": ("e = day", "day", "day as a value", "attributes"),
    "computed receivers": (
        "moment.emit(eCall(1.0, receivers=self.id))", "self.id", "computed receivers", "name one",
    ),
    "two forms of events": (
        "moment.emit(eCall(1.0))\nmoment.emit(eCall(1.0, receivers=['a']))",
        "eCall(1.0, receivers=['a'])", "with and without a receiver", "one form",
    ),
    "another string": ("return Scene(())", "Scene(())", "this result", "EMPTY"),
    "newborn first": ("return self.child() + self.string", "self.string", "after newborns",
                      "self.string + self.child"),
    "newborn attribute": ("return self.string + self.child(wool=1.0)", "self.child(wool=1.0)",
                          "no wool", "it has"),
    "scope": ("self.x = len(self.scope)", "len(self.scope)", "length", ""),
    "changing method": ("self.x = self.grow()", "self.x", "changes attributes", "return the value"),
    "recursion": ("self.n = again(3)", "again(n - 1)", "calls itself", "loop"),
    "no result": ("self.x = silent(self.x)", "def silent", "no value on one path", "return"),
    "wrong call": ("self.x = twice()", "twice()", "missing a required argument", ""),
    "computed values in a tuple": ("for y in (1.0, self.x):\n    self.n += 1", "self.x",
                                   "a computed value", "values = [self.x, self.y]"),
    "tuples in one name": ("for step in ((0, 1), (1, 0)):\n    self.n += 1", "((0, 1), (1, 0))",
                           "as a value", "for dx, dy in"),
    "names for numbers": ("for a, b in STARTS:\n    self.n += 1", "a, b", "2 names for items",
                          "as many values"),
    "other number of names": ("for a, b in ((1, 2), (1, 2, 3)):\n    self.n += 1", "a, b",
                              "2 names for items", "as many values"),
    "texts and numbers in a tuple": ("for a in (1, 'b'):\n    self.n += 1", "(1, 'b')",
                                     "a text and an int in one place", "one type"),
    "empty tuple": ("for a in ():\n    self.n += 1", "()", "the tuple ()", "1 to 10,000"),
    "attribute as a loop name": ("for self.n in (1, 2):\n    pass", "self.n", "a loop over this",
                                 "a name for each"),
    "enumerate": ("for i, y in enumerate(STARTS):\n    pass", "enumerate(STARTS)",
                  "the function enumerate", "range(len"),
    "zip": ("for a, b in zip(STARTS, STARTS):\n    pass", "zip(STARTS", "the function zip", "range(len"),
    "tuple in a variable": ("steps = (1, 2)", "(1, 2)", "a tuple here", "top of the module"),
    "loop over texts": ("for c in self.name:\n    pass", "self.name", "a loop over this", "range"),
    "length not constant": ("y = [0.0] * self.n", "self.n", "not a constant", "constant length"),
    "slice": ("self.x = STARTS[0:1][0]", "STARTS[0:1]", "", ""),
    "chain": ("self.calm = 0 < moment.chance.random() < 1",
              "0 < moment.chance.random() < 1", "a chain of comparisons", "variable first"),
}  # fmt: skip


def made(tmp_path, monkeypatch, body):
    """The module with a class whose compiled method has this body."""
    text = HEAD + "\n".join("        " + line for line in body.split("\n"))
    path = tmp_path / "refused_world.py"
    path.write_text(text, encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "refused_world", raising=False)
    return import_module("refused_world")


@pytest.mark.parametrize("case", REFUSED)
def test_it_is_refused_with_its_place_and_an_alternative(case, tmp_path, monkeypatch):
    body, marked, wrong, instead = REFUSED[case]
    with pytest.raises(NotCompilable) as raised:
        made(tmp_path, monkeypatch, body)
    message = str(raised.value)
    problem, place, shown, marker, advice = message.split("\n")
    assert " cannot be compiled: " in problem
    assert wrong in problem
    assert f"{tmp_path / 'refused_world.py'}:" in place
    number = int(place.split(":")[1].split(",")[0])
    line = (tmp_path / "refused_world.py").read_text(encoding="utf-8").split("\n")[number - 1]
    assert shown.strip() == line.strip()
    begin = marker.index("^")
    assert shown[begin:].startswith(marked.split("\n")[0]), message
    assert advice.startswith("  instead: ")
    assert instead in advice
    assert advice in described(raised.value)


def test_a_source_that_is_not_available(monkeypatch):
    namespace = {}
    text = HEAD + "        self.x = 1.0\n"
    with pytest.raises(NotCompilable, match="source is not available"):
        exec(compile(text, "<stdin>", "exec"), namespace)


def test_a_decorated_method(tmp_path, monkeypatch):
    text = """
from functools import wraps
from minerva_bus import Agent, EventType, on

def loud(function):
    @wraps(function)
    def inner(self, event, moment):
        return function(self, event, moment)
    return inner

class Sheep(Agent, symbol="ASheep"):
    @on("eDay", compiled=True)
    @loud
    def live(self, day, moment):
        pass
"""
    (tmp_path / "decorated_world.py").write_text(text, encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "decorated_world", raising=False)
    with pytest.raises(NotCompilable, match="another decorator"):
        import_module("decorated_world")


def test_attributes_that_are_no_columns():
    from minerva_bus import Agent, on

    with pytest.raises(NotCompilable, match="parts is a list of real"):

        class Odd(Agent, symbol="AOdd"):
            parts: tuple[float, ...] = ()

            @on("eDay", compiled=True)
            def live(self, day, moment):
                pass
