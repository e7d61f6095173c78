"""Checks of rules and kernels when they are declared, with the messages of compiled methods."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Iterator, Mapping
from types import BuiltinFunctionType, FunctionType
from typing import Any, Final, cast

from minerva_bus.compiled.origin import NotCompilable, Origin
from minerva_bus.compiled.refused import EXPRESSIONS, FUNCTIONS_INSTEAD, STATEMENTS
from minerva_bus.compiled.sources import is_portable
from minerva_bus.errors import nearest
from minerva_bus.space.kernels import Kernel, helpers

_POSSIBLE: Final = (ast.List, ast.Tuple, ast.Slice, ast.Starred)
"""Expressions that rules may use, but methods of agents not: numba has a type for them."""
REFUSED: Final = {**STATEMENTS, **EXPRESSIONS}
"""Those of methods of agents."""
_REMEDY: Final = "use numbers, if, for, while and the functions for rules"


def check_rule(function: FunctionType, tables: Mapping[str, tuple[str, ...]]) -> None:
    """Check a rule and the kernels that it calls, as far as their source is available.

    Args:
        function: the rule, whose decorators have not changed it.
        tables: by parameter that is a table, its names.

    Raises:
        NotCompilable: a construct, function or name of a table that no rule can use.

    """
    _check(function, tables, set())


def uncompilable(function: FunctionType, line: int, what: str) -> NotCompilable:
    """The error of a line for which numba has no types. `what` is numba's reason."""
    origin = _origin(function)
    if origin is None:
        return NotCompilable(f"{function.__qualname__} cannot be compiled: {what}")
    statements = [node for node in ast.walk(origin.tree) if isinstance(node, ast.stmt)]
    node = next((each for each in statements if each.lineno == line), origin.tree)
    return origin.problem(node, what, _REMEDY)


def _check(
    function: FunctionType, tables: Mapping[str, tuple[str, ...]], known: set[FunctionType]
) -> None:
    known.add(function)
    origin = _origin(function)
    if origin is not None:
        if free := function.__code__.co_freevars:
            what = f"{free[0]}, a variable of the function around it"
            raise origin.problem(origin.tree, what, f"define {free[0]} at the top of the module")
        for node in _inside(origin.tree):
            _check_node(origin, node, tables)
    for _, helper in helpers(function):
        own = not helper.function.__module__.startswith("minerva_bus.space.")
        if own and helper.function not in known:
            _check(helper.function, {}, known)


def _origin(function: FunctionType) -> Origin | None:
    """The source of a function; None if there is none, as in an interactive session."""
    try:
        return Origin.of(function)
    except NotCompilable:
        return None


def _inside(tree: ast.FunctionDef) -> Iterator[ast.AST]:
    """The nodes of a function's body, without annotations and messages of errors."""
    pending: list[ast.AST] = list(reversed(tree.body))
    while pending:
        node = pending.pop()
        yield node
        documents = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        if documents or isinstance(node, ast.Raise):
            continue
        parts = [node.test] if isinstance(node, ast.Assert) else list(ast.iter_child_nodes(node))
        if isinstance(node, ast.AnnAssign):
            parts.remove(node.annotation)
        pending += reversed(parts)


def _check_node(origin: Origin, node: ast.AST, tables: Mapping[str, tuple[str, ...]]) -> None:
    if type(node) in REFUSED and not isinstance(node, _POSSIBLE):
        raise origin.problem(node, *REFUSED[type(node)])
    if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
        names = tables.get(node.value.id)
        if names is not None and node.attr not in names:
            shown = nearest(node.attr, list(names))
            raise origin.problem(node, f"{node.value.id} has no {node.attr}{shown}", _REMEDY)
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        raise origin.problem(node, "a text", "use numbers: a table has no texts")
    if isinstance(node, ast.Call):
        _check_call(origin, node)


def _check_call(origin: Origin, node: ast.Call) -> None:
    function: Any = None
    if isinstance(node.func, ast.Name):
        function = origin.lookup(node.func.id)
    name = ast.unparse(node.func)
    if isinstance(function, Kernel):
        _check_arguments(origin, node, cast("Kernel[..., Any]", function))
    elif isinstance(function, FunctionType) and not is_portable(function):
        raise origin.problem(node, f"the function {name}", f"mark {name} with @kernel")
    elif isinstance(function, BuiltinFunctionType | type) and name in _NO_BUILTINS:
        raise origin.problem(node, f"the function {name}", FUNCTIONS_INSTEAD[name])


def _check_arguments(origin: Origin, node: ast.Call, kernel: Kernel[..., Any]) -> None:
    if any(isinstance(argument, ast.Starred) for argument in node.args):
        return
    signature = inspect.signature(kernel.function)
    try:
        signature.bind(*node.args, **{str(each.arg): each.value for each in node.keywords})
    except TypeError as error:
        names = ", ".join(signature.parameters)
        called = f"{kernel.__name__}({names})"
        raise origin.problem(node, f"this call: {error}", f"write {called}") from None


_NO_BUILTINS: Final = frozenset(("str", "isinstance", "getattr", "setattr", "open", "list"))
