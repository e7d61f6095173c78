"""The source of a function as a syntax tree, and errors that point into it."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import FunctionType
from typing import Any, Final, cast

from minerva_bus.source import SourceLine, handler_name
from minerva_bus.world.accelerator import REMEDY, NotCompilable

MISSING: Final = object()


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
            lines, first = inspect.getsourcelines(code)
        except (OSError, TypeError):
            raise NotCompilable(
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
