"""Functions that a rule may call: those with the result of Python, each time.

Kernels, the functions that methods of agents may call, those of Python for loops, and those of
numpy that are exact. Random numbers, clocks and files are refused: numba compiles some of them, and
two runs would differ. Others of numpy have other last bits as machine code, or other types.
"""

from __future__ import annotations

import ast
from types import FunctionType, ModuleType
from typing import Any, Final

import numpy as np

from minerva_fast.compiled.functions import FUNCTIONS, OF_PORTABLE
from minerva_fast.compiled.origin import MISSING, Origin
from minerva_fast.compiled.refused import FUNCTIONS_INSTEAD
from minerva_fast.compiled.sources import is_portable
from minerva_fast.space.kernels import Kernel

_OF_LOOPS: Final = (enumerate, len, print, range, zip)
_OF_NUMPY: Final = frozenset(
    (
        "absolute", "fabs", "full", "isfinite", "isinf", "isnan", "maximum", "minimum", "ones",
        "rint", "sign", "sqrt", "zeros",
    )
)  # fmt: skip
_ARRAYS: Final = {"zeros": 1, "ones": 1, "full": 2}
"""Functions that make an array, with the place of the type of its items."""
_ITEM_TYPES: Final = (bool, float, int, np.bool_, np.float64, np.int64)
_OF_TWO: Final = ("atan2", "copysign", "fmod", "hypot", "power")
_IN_MATH: Final = {
    **{name: f"math.{name}" for name in ("ceil", "floor", "trunc")},
    **{name: f"portable.{name}" for name in OF_PORTABLE},
    **{f"arc{name}": f"portable.a{name}" for name in ("cos", "sin", "tan")},
    "arctan2": "portable.atan2",
}
"""What to write in place of functions of numpy."""
_METHODS: Final = ("append", "copy", "fill", "pop")
"""Methods of lists and arrays."""
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
    """Raise NotCompilable if a call is of a function that a rule cannot call, or wrong."""
    function = called(origin, node.func)
    if function is MISSING:
        _check_method(origin, node)
        return
    if not callable(function):
        return
    if not _is_possible(function):
        name = ast.unparse(node.func)
        raise origin.problem(node, f"the function {name}", _instead(name, function))
    if function in FUNCTIONS:
        _check_count(origin, node, function)
    elif getattr(function, "__name__", "") in _ARRAYS:
        _check_items(origin, node)


def _check_method(origin: Origin, node: ast.Call) -> None:
    """Methods of values are those of lists and arrays."""
    method = node.func
    if isinstance(method, ast.Attribute) and method.attr not in _METHODS:
        instead = FUNCTIONS_INSTEAD.get(method.attr, _REMEDY)
        raise origin.problem(node, f"the method {method.attr} of a value", instead)


def _check_count(origin: Origin, node: ast.Call, function: Any) -> None:
    """Functions of numbers have as many arguments as in methods of agents."""
    name, count = ast.unparse(node.func), len(node.args)
    if node.keywords:
        raise origin.problem(node, "named arguments of this function", "write them in order")
    if function in (min, max):
        if count < 2:
            instead = "write a for loop, or name two values or more"
            raise origin.problem(node, f"{name} of one value", instead)
    elif function is round and count > 1:
        instead = "round(100 * x) / 100, if that is precise enough"
        raise origin.problem(node, "round with a number of digits", instead)
    elif count != (expected := _count(function)):
        raise origin.problem(node, f"{count} arguments; expected {expected}", _REMEDY)


def _count(function: Any) -> int:
    return 2 if getattr(function, "__name__", "") in _OF_TWO else 1


def _check_items(origin: Origin, node: ast.Call) -> None:
    """An array has items of 64 bits, or bools, as numbers of Python have."""
    name = ast.unparse(node.func)
    given = node.args[_ARRAYS[name.rpartition(".")[2]] :]
    given += [each.value for each in node.keywords if each.arg == "dtype"]
    others = [each.arg for each in node.keywords if each.arg != "dtype"]
    if others or len(given) > 1:
        raise origin.problem(node, f"these arguments of {name}", "write its shape and dtype only")
    if given and called(origin, given[0]) not in _ITEM_TYPES:
        instead = "write dtype=float, dtype=int or dtype=bool"
        raise origin.problem(given[0], f"an array of {ast.unparse(given[0])}", instead)


def _is_possible(function: Any) -> bool:
    if isinstance(function, Kernel) or is_portable(function) or function in _OF_LOOPS:
        return True
    of_numpy = str(getattr(function, "__module__", "")).split(".")[0] == "numpy"
    if isinstance(function, np.ufunc) or (of_numpy and not _is_random(function)):
        return getattr(function, "__name__", "") in _OF_NUMPY
    return _is_key(function) and function in FUNCTIONS


def _is_key(function: Any) -> bool:
    try:
        hash(function)
    except TypeError:
        return False
    return True


def _is_random(function: Any) -> bool:
    instance: object = getattr(function, "__self__", None)
    modules = {str(getattr(function, "__module__", "")), type(instance).__module__}
    return any(each.startswith(_RANDOM) for each in modules)


def _is_number_of_numpy(function: Any) -> bool:
    return isinstance(function, type) and issubclass(function, np.generic)


def _instead(name: str, function: Any) -> str:
    if _is_random(function):
        return _DRAWS
    last = name.split(".")[-1]
    if last.startswith("empty"):
        return f"write {name.replace('empty', 'zeros')}: an empty array has any values"
    if getattr(function, "__module__", "") == "time":
        return FUNCTIONS_INSTEAD["time"]
    if last in ("pow", "power"):
        return "write portable.power(x, y)"
    if _is_number_of_numpy(function):
        return "write int(...) or float(...)"
    if last in _IN_MATH and _IN_MATH[last] != name:
        return f"write {_IN_MATH[last]}"
    if isinstance(function, FunctionType):
        return f"mark {name} with @kernel"
    return FUNCTIONS_INSTEAD.get(last, _REMEDY)
