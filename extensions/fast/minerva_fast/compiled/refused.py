"""Constructs that no compiled code supports: what they are, and what to write instead.

Methods of agents and rules of spaces refuse these with the same words.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping
from typing import Final

REAL_EVERYWHERE: Final = "make it a real everywhere: write 0.0 for 0, or use float(...)"
LOOP: Final = "write a for loop that adds up or counts in a variable"

STATEMENTS: Final[Mapping[type[ast.AST], tuple[str, str]]] = {
    ast.Try: ("try", "test the condition before: if x != 0: ..."),
    ast.With: ("with", "a method uses no resources; services do"),
    ast.Import: ("an import in a method", "import at the top of the module"),
    ast.ImportFrom: ("an import in a method", "import at the top of the module"),
    ast.FunctionDef: ("a function within a method", "define it at the top of the module"),
    ast.AsyncFunctionDef: ("a function within a method", "define it at the top of the module"),
    ast.ClassDef: ("a class within a method", "define it at the top of the module"),
    ast.Global: ("global", "keep the value in an attribute of the agent"),
    ast.Nonlocal: ("nonlocal", "keep the value in an attribute of the agent"),
    ast.Delete: ("del", "set the value to 0 or False"),
    ast.Match: ("match", "write if and elif"),
    ast.AsyncFor: ("async for", "write a for loop"),
    ast.AsyncWith: ("async with", "a method uses no resources; services do"),
}

EXPRESSIONS: Final[Mapping[type[ast.AST], tuple[str, str]]] = {
    ast.ListComp: ("a list comprehension", LOOP),
    ast.SetComp: ("a set comprehension", LOOP),
    ast.DictComp: ("a dict comprehension", LOOP),
    ast.GeneratorExp: ("a generator expression", LOOP),
    ast.Dict: ("a dict", "use attributes, or a tuple that is indexed by an int"),
    ast.Set: ("a set", "compare with each value: x == 1 or x == 2"),
    ast.List: ("a list here", "assign it to a variable first: values = [0.0, 0.0]"),
    ast.Tuple: (
        "a tuple here",
        "use a variable for each value, or name it at the top of the module",
    ),
    ast.Lambda: ("a lambda", "define a function at the top of the module and call it"),
    ast.JoinedStr: ("an f-string", "use constant texts only"),
    ast.NamedExpr: ("an assignment within an expression", "assign in a statement of its own"),
    ast.Await: ("await", "evolution is not asynchronous; emit an event instead"),
    ast.Yield: ("yield", "emit events with moment.emit"),
    ast.YieldFrom: ("yield", "emit events with moment.emit"),
    ast.Starred: ("an argument with *", "write each argument"),
    ast.Slice: ("a slice", "write a for loop over the index"),
}

FUNCTIONS_INSTEAD: Final[Mapping[str, str]] = {
    "print": "emit an event, or log in a method that is not compiled",
    "sum": LOOP,
    "sorted": "keep the least value in a variable of a for loop",
    "reversed": "count down: for i in range(len(x) - 1, -1, -1)",
    "clip": "write max(low, min(high, x))",
    "gcd": "write a while loop: while b != 0: a, b = b, a % b",
    "isqrt": "write int(math.sqrt(n)), if that is precise enough",
    "isclose": "compare the difference: abs(a - b) < 1e-9",
    "range": "use it in `for i in range(n)` only",
    "enumerate": "use it in `for i, x in enumerate(TABLE)` only",
    "zip": "use it in `for a, b in zip(FIRST, SECOND)` only",
    "any": "write a for loop with a bool variable",
    "all": "write a for loop with a bool variable",
    "list": "write the items: values = [0.0, 0.0]",
    "str": "use constant texts only",
    "hypot": "use portable.hypot, which is the same on every machine",
    "dist": "use portable.hypot(x1 - x2, y1 - y2)",
    "pow": "use **",
    "divmod": "write a // b and a % b",
    "array": "write np.zeros(n), and assign its items in a loop",
    "isinstance": "attributes have the types that the class declares",
    "getattr": "name the attribute: self.x",
    "setattr": "name the attribute: self.x = ...",
    "time": "use moment.time: results must not depend on a clock",
    "open": "a method uses no files; services do",
}
"""What to write in place of a function, by its name."""

_AN_INDEX: Final = "draw an index: TABLE[moment.chance.integers(len(TABLE))]"
CHOICES: Final[Mapping[str, str]] = {
    "choice": _AN_INDEX,
    "choices": _AN_INDEX,
    "sample": _AN_INDEX,
    "randint": "write moment.chance.integers(low, high), without high itself",
    "gauss": "write moment.chance.normal(mean, deviation)",
    "poisson": "add up intervals of moment.chance.exponential() in a loop",
}
"""What to write in place of a draw that `moment.chance` does not have, by its name."""
TEXT_AS_NUMBER: Final = "a number in a text", "write the number, or math.inf"
"""`float("inf")`: what it is, and what to write instead."""
