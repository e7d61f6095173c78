"""The source of a function as a syntax tree, errors that point into it, and what is refused there.

Methods of agents and rules of spaces refuse constructs that no compiled code supports with the same
words.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import FunctionType
from typing import Any, Final, cast

from minerva_bus.user_code import SourceLine, handler_name, source_of
from minerva_bus.world.class_declaration import REMEDY, NotCompilable

MISSING: Final = object()


class Undefined(NotCompilable):
    """A name is not defined yet."""


class Unreadable(NotCompilable):
    """The source of a function is not available."""


@dataclass(frozen=True, slots=True)
class Origin:
    """A function with its syntax tree; lines and columns of the tree are those of the file."""

    function: Any
    """A plain function; not typed as one, which is a descriptor."""
    tree: ast.FunctionDef
    file: str
    lines: tuple[str, ...]

    @property
    def name(self) -> str:
        """The qualified name, such as `Fox.starve`."""
        return handler_name(self.function)

    @staticmethod
    def of(function: Callable[..., Any]) -> Origin:
        """The source of a plain function. Raises NotCompilable."""
        name = handler_name(function)
        if not isinstance(function, FunctionType) or hasattr(function, "__wrapped__"):
            raise NotCompilable(
                f"{name} cannot be compiled: another decorator has replaced the function;"
                f" remove it, or {REMEDY}"
            )
        code = function.__code__
        try:
            lines, first = source_of(code)
        except OSError:
            raise Unreadable(
                f"{name} cannot be compiled: its source is not available ({code.co_filename});"
                " define the class in a file"
            ) from None
        # Within `if True:` an indented function is a program, and columns stay those of the file.
        # Comments may precede it with less indentation.
        indented = lines[0][:1] in " \t"
        text = "if True:\n" * indented + "".join(lines)
        try:
            tree = ast.parse(text)
        except SyntaxError:
            raise NotCompilable(
                f"{name} cannot be compiled: its source cannot be read alone"
            ) from None
        ast.increment_lineno(tree, first - 1 - indented)
        body = cast("ast.If", tree.body[0]).body if indented else tree.body
        definition = body[0]
        if not isinstance(definition, ast.FunctionDef):
            raise NotCompilable(f"{name} cannot be compiled: it is not a `def` function")
        return Origin(function, definition, code.co_filename, ("",) * (first - 1) + tuple(lines))

    def problem(self, node: ast.AST, what: str, instead: str = "") -> NotCompilable:
        """The error of a part of the function: what is not possible, and what to write instead."""
        line: int = getattr(node, "lineno", self.tree.lineno)
        column: int = getattr(node, "col_offset", 0)
        text = self.lines[line - 1].rstrip() if 0 < line <= len(self.lines) else ""
        # Offsets of the tree count bytes.
        begin = len(text.encode()[:column].decode(errors="replace"))
        end_line: int = getattr(node, "end_lineno", line) or line
        end: int = getattr(node, "end_col_offset", column) if end_line == line else len(text)
        width = max(1, len(text.encode()[:end].decode(errors="replace")) - begin)
        bare = text.lstrip()
        marker = " " * max(0, begin - (len(text) - len(bare))) + "^" * min(width, len(bare) or 1)
        shown = f"\n    {bare}\n    {marker}" if bare else ""
        advice = instead or REMEDY
        return NotCompilable(
            f"{self.name} cannot be compiled: {what}\n"
            f"  {SourceLine(self.file, line).where}, in {self.name}{shown}\n"
            f"  instead: {advice}"
        )

    def lookup(self, name: str) -> Any:
        """The object of a name that is not a local variable; MISSING if there is none."""
        return lookup(self.function, name)


def lookup(function: FunctionType, name: str) -> Any:
    """The object of a free or global name of a function; MISSING if there is none."""
    free = function.__code__.co_freevars
    if name in free and function.__closure__ is not None:
        try:
            return function.__closure__[free.index(name)].cell_contents
        except ValueError:  # a variable that is assigned later
            return MISSING
    scope: Mapping[str, Any] = function.__globals__
    if name in scope:
        return scope[name]
    builtins: Any = scope.get("__builtins__", {})
    known = cast("Mapping[str, Any]", builtins if isinstance(builtins, dict) else vars(builtins))
    return known.get(name, MISSING)


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
    "enumerate": "count in a variable, or loop over the index: for i in range(len(TABLE))",
    "zip": "loop over the index: for i in range(len(FIRST))",
    "any": "write a for loop with a bool variable",
    "all": "write a for loop with a bool variable",
    "list": "write the items: values = [0.0, 0.0]",
    "str": "use constant texts only",
    "hypot": "use portable.hypot, which is the same on every machine",
    "dist": "use portable.hypot(x1 - x2, y1 - y2)",
    "pow": "use **",
    "divmod": "write a // b and a % b",
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
