"""Functions that a rule may call: those with the same result each time and everywhere.

Kernels, functions of `portable` and `math`, numpy's functions of numbers, and Python's own that
numba compiles. Random numbers, clocks and files are refused: numba compiles some of them, and two
runs would differ.
"""

from __future__ import annotations

import ast
import builtins
import math
from types import FunctionType, ModuleType
from typing import Any, Final

import numpy as np

from minerva_bus.compiled.origin import MISSING, Origin
from minerva_bus.compiled.refused import FUNCTIONS_INSTEAD
from minerva_bus.compiled.sources import is_portable
from minerva_bus.space.kernels import Kernel

_BUILTINS: Final = frozenset(
    (
        "abs", "bool", "divmod", "enumerate", "float", "int", "len", "max", "min", "print", "range",
        "reversed", "round", "sum", "zip",
    )
)  # fmt: skip
_RANDOM: Final = ("random", "numpy.random", "secrets")
_DRAWS: Final = "draw numbers from the parameter of type Draws: random(draws), integers(draws, 6)"
_REMEDY: Final = "use numbers, if, for, while and the functions for rules"


def called(origin: Origin, node: ast.expr) -> Any:
    """The object that a name or `module.name` refers to; MISSING if it is a variable or unknown."""
    if isinstance(node, ast.Name):
        local = node.id in origin.function.__code__.co_varnames
        return MISSING if local else origin.lookup(node.id)
    if isinstance(node, ast.Attribute):
        owner = called(origin, node.value)
        return getattr(owner, node.attr, MISSING) if isinstance(owner, ModuleType) else MISSING
    return MISSING


def check_called(origin: Origin, node: ast.Call) -> None:
    """Raise NotCompilable if a call is of a function that a rule cannot call."""
    function = called(origin, node.func)
    if function is MISSING or not callable(function) or _is_possible(function):
        return
    name = ast.unparse(node.func)
    raise origin.problem(node, f"the function {name}", _instead(name, function))


def _is_possible(function: Any) -> bool:
    if isinstance(function, Kernel | np.ufunc) or is_portable(function):
        return True
    name = getattr(function, "__name__", "")
    if getattr(builtins, name, None) is function:
        return name in _BUILTINS
    if getattr(math, name, None) is function:
        return True
    of_numpy = str(getattr(function, "__module__", "")).split(".")[0] == "numpy"
    return of_numpy and not _is_random(function) and not name.startswith("empty")


def _is_random(function: Any) -> bool:
    instance: object = getattr(function, "__self__", None)
    modules = {str(getattr(function, "__module__", "")), type(instance).__module__}
    return any(each.startswith(_RANDOM) for each in modules)


def _instead(name: str, function: Any) -> str:
    if _is_random(function):
        return _DRAWS
    last = name.split(".")[-1]
    if last.startswith("empty"):
        return f"write {name.replace('empty', 'zeros')}: an empty array has any values"
    if getattr(function, "__module__", "") == "time":
        return FUNCTIONS_INSTEAD["time"]
    if function is pow:
        return "write portable.power(x, y)"
    if isinstance(function, FunctionType):
        return f"mark {name} with @kernel"
    return FUNCTIONS_INSTEAD.get(last, _REMEDY)
