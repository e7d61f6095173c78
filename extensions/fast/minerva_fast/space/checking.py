"""Checks of rules and kernels when they are declared, with the messages of compiled methods.

- Functions: kernels, the functions that methods of agents may call, those of Python for loops, and
  those of numpy that are exact. Random numbers, clocks and files are refused: numba compiles some
  of them, and two runs would differ. Others of numpy have other last bits as machine code, or
  other types.
- Variables that may have no value when they are read: machine code would read what memory happens
  to contain there.
- Matrices: those of which a rule does more than read items are taken as changed. A rule gets the
  memory of the string for a matrix that it only reads. If the check takes a change for reading, the
  compiler refuses the rule, because such an array is read-only there.
"""

from __future__ import annotations

import ast
import inspect
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from enum import Enum
from types import FunctionType, ModuleType
from typing import Any, Final, cast

import numpy as np

from minerva_bus.errors import nearest
from minerva_bus.world.class_declaration import NotCompilable
from minerva_fast.compiled.functions import FUNCTIONS, OF_PORTABLE
from minerva_fast.compiled.machine_code import is_portable
from minerva_fast.compiled.origin import (
    EXPRESSIONS,
    FUNCTIONS_INSTEAD,
    MISSING,
    REAL_EVERYWHERE,
    STATEMENTS,
    TEXT_AS_NUMBER,
    Origin,
)
from minerva_fast.space import kernels as draws
from minerva_fast.space.kernels import MIXED, READ_ONLY, Kernel, helpers

_POSSIBLE: Final = (ast.List, ast.Tuple, ast.Slice)
"""Expressions that rules may use, but methods of agents not: numba has a type for them."""
REFUSED: Final = {**STATEMENTS, **EXPRESSIONS}
"""Those of methods of agents."""
_BITS: Final = 2**63
_ITEMS: Final = (np.bool_, np.float64, np.int64)
"""Types of the items of constant arrays, which are those of Python's numbers."""
_REMEDIES: Final = {
    MIXED: REAL_EVERYWHERE,
    READ_ONLY: "change the subject of the rule, or another matrix, by the name of its parameter",
}
"""Instead of what the compiler refuses."""
_MOVES: Final = {
    "cell": "move_to({table}, i, cell)",
    "x": "go_to({table}, i, x, y)",
    "y": "go_to({table}, i, x, y)",
}
"""How a rule changes what it may not assign to."""


@dataclass(frozen=True, slots=True)
class ParameterAccess:
    """What a function may do with a parameter.

    Attributes:
        names: what a table has; none for a matrix or a stream.
        changed: those of its names to which a function may assign.
        before: whether it is the state before the rule.
        draws: whether it is the random stream.

    """

    names: tuple[str, ...] = ()
    changed: tuple[str, ...] = ()
    before: bool = False
    draws: bool = False


def check_rule(function: FunctionType, parameters: Mapping[str, ParameterAccess]) -> None:
    """Check a rule and the kernels that it calls, as far as their source is available.

    Args:
        function: the rule, whose decorators have not changed it.
        parameters: those that are a table, a matrix or a stream, by name.

    Raises:
        NotCompilable: a construct, function, name or assignment that no rule can have.

    """
    _check(function, parameters, set())
    for each in Kernel(function).called:
        if each in each.called:
            raise Origin.of(each.function).problem(
                Origin.of(each.function).tree,
                f"{each.__name__}, which calls itself",
                "write a loop",
            )


def uncompilable(rule: Kernel[..., Any], file: str, line: int, what: str) -> NotCompilable:
    """The error of a line for which numba has no types, in a rule or a kernel that it calls.

    Args:
        rule: the rule.
        file: the name of the file of the line.
        line: its number.
        what: numba's reason.

    """
    instead = _REMEDIES.get(what, _REMEDY)
    for each in (rule, *rule.called):
        origin = _origin(each.function) if each.function.__code__.co_filename == file else None
        for node in ast.walk(origin.tree) if origin is not None else ():
            if isinstance(node, ast.stmt) and node.lineno == line:
                return cast("Origin", origin).problem(node, what, instead)
    return NotCompilable(f"{rule.__name__} cannot be compiled: {what}\n  instead: {instead}")


def _check(
    function: FunctionType,
    parameters: Mapping[str, ParameterAccess],
    known: set[tuple[FunctionType, tuple[tuple[str, ParameterAccess], ...]]],
) -> None:
    """Check a function, and each kernel with the parameters that calls give it."""
    known.add((function, tuple(parameters.items())))
    pending: dict[FunctionType, list[Mapping[str, ParameterAccess]]] = {}
    for _, helper in helpers(function):
        pending[helper.function] = []
    origin = _origin(function)
    if origin is not None:
        if free := function.__code__.co_freevars:
            what = f"{free[0]}, a variable of the function around it"
            raise origin.problem(origin.tree, what, f"define {free[0]} at the top of the module")
        body = _Body(origin, parameters)
        for node in _inside(origin.tree):
            body.check(node)
            kernel = called(origin, node.func) if isinstance(node, ast.Call) else None
            if isinstance(kernel, Kernel):
                passed = body.passed(cast("ast.Call", node), cast("Kernel[..., Any]", kernel))
                pending.setdefault(cast("Any", kernel).function, []).append(passed)
        check_values(origin)
    for helper, calls in pending.items():
        for passed in () if helper.__module__.startswith("minerva_fast.space.") else calls or [{}]:
            if (helper, tuple(passed.items())) not in known:
                _check(helper, passed, known)


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


class _Body:
    """The checks of a function's nodes."""

    def __init__(self, origin: Origin, parameters: Mapping[str, ParameterAccess]) -> None:
        self._origin = origin
        self._parameters = parameters
        self._aliases: dict[str, ast.expr] = {}

    def check(self, node: ast.AST) -> None:
        """Raise NotCompilable if a rule cannot have a node."""
        origin = self._origin
        if type(node) in REFUSED and not isinstance(node, _POSSIBLE):
            raise origin.problem(node, *REFUSED[type(node)])
        if isinstance(node, ast.Constant):
            self._check_constant(node, node.value)
        if isinstance(node, ast.Name | ast.Attribute):
            self._check_constant(node, called(origin, node))
        if isinstance(node, ast.BinOp | ast.AugAssign) and isinstance(node.op, ast.Pow):
            self._check_power(node)
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
            self._aliases[node.targets[0].id] = node.value
        if isinstance(node, ast.Attribute):
            self._check_name(node)
        if isinstance(node, ast.Subscript):
            self._check_index(node)
        if isinstance(node, ast.For):
            self._check_whole(node.iter)
        if isinstance(node, ast.Call):
            self._check_call(node)

    def _check_constant(self, node: ast.expr, value: Any) -> None:
        """Constants are numbers of 64 bits, and tuples and arrays of such."""
        problem = self._origin.problem
        if isinstance(value, str | bytes):
            raise problem(node, "a text", "use numbers: a table has no texts")
        if isinstance(value, complex):
            raise problem(node, "a complex number", "use two real numbers")
        if isinstance(value, int) and not -_BITS <= value < _BITS:
            raise problem(node, "an int of more than 64 bits", "write a real number, such as 1e20")
        if isinstance(value, list | dict | set):
            name = type(cast("Any", value)).__name__
            raise problem(node, f"a {name} of the module", "write a tuple of numbers")
        if isinstance(value, np.generic | np.ndarray):
            kind: Any = cast("Any", value).dtype
            if kind not in _ITEMS:
                instead = "convert it to float64 or int64, as numbers of Python are"
                raise problem(node, f"a constant of {kind}", instead)

    def passed(self, node: ast.Call, kernel: Kernel[..., Any]) -> Mapping[str, ParameterAccess]:
        """The parameters of a kernel that get those of this function."""
        if any(isinstance(argument, ast.Starred) for argument in node.args):
            return {}
        bound = inspect.signature(kernel.function).bind(*node.args, **_keywords(node))
        return {
            name: self._parameters[argument.id]
            for name, argument in bound.arguments.items()
            if isinstance(argument, ast.Name) and argument.id in self._parameters
        }

    def _of(self, node: ast.AST) -> ParameterAccess | None:
        return self._parameters.get(node.id) if isinstance(node, ast.Name) else None

    def _check_name(self, node: ast.Attribute) -> None:
        """Names of tables exist, and a stream has none."""
        known, shown = self._of(node.value), ast.unparse(node.value)
        owner: object = called(self._origin, node.value)
        if isinstance(owner, type) and not issubclass(owner, Enum):
            instead = (
                f"define it at the top of the module: {node.attr.upper()} = {shown}.{node.attr}"
            )
            raise self._origin.problem(node, "an attribute of a class", instead)
        if known is not None and known.draws:
            named = node.attr in draws.__dict__
            instead = f"write {node.attr}({shown}, ...)" if named else _REMEDY
            raise self._origin.problem(node, f"{shown}, a random stream, has no methods", instead)
        if known is not None and known.names and node.attr not in known.names:
            hint = nearest(node.attr, list(known.names))
            instead = f"declare it in the class of {shown}: {node.attr}: Column"
            raise self._origin.problem(node, f"{shown} has no {node.attr}{hint}", instead)

    def _check_index(self, node: ast.Subscript) -> None:
        """An index is one number, and what it assigns to may be changed."""
        self._check_whole(node.value, "NAME[i]")
        array: ast.expr = node.value
        if isinstance(array, ast.Name):
            array = self._aliases.get(array.id, array)
        owner = array.value if isinstance(array, ast.Attribute) else array
        known = self._of(owner)
        if known is None:
            return
        if known.draws:
            instead = "draw numbers: random(draws), integers(draws, 6)"
            raise self._origin.problem(node, "an item of a random stream", instead)
        if isinstance(node.slice, ast.Tuple | ast.Slice):
            name = ast.unparse(node.value)
            raise self._origin.problem(
                node, "an index that is not one number", f"write {name}[y * width + x] for a cell"
            )
        if isinstance(node.ctx, ast.Store):
            self._check_change(node, array, ast.unparse(owner), known)

    def _check_change(
        self, node: ast.Subscript, array: ast.expr, table: str, known: ParameterAccess
    ) -> None:
        name = array.attr if isinstance(array, ast.Attribute) else ""
        if name not in known.names and known.names:
            return  # which the check of the name reports
        if known.before:
            instead = f"change the subject of the rule: {table} is the state before it"
        elif not known.names or name in known.changed:
            return
        else:
            instead = _MOVES.get(name, "keep other numbers in columns of the table")
            instead = f"write {instead.format(table=table)}" if name in _MOVES else instead
        raise self._origin.problem(node, f"an assignment to {ast.unparse(node.value)}", instead)

    def _check_whole(self, node: ast.expr, form: str = "NAME[k]") -> None:
        """Refuse a table in place of one of its columns."""
        known = self._of(node)
        if known is not None and known.names:
            table = ast.unparse(node)
            column = known.changed[0] if known.changed else known.names[-1]
            raise self._origin.problem(
                node,
                f"{table} as a whole",
                f"write {table}.{form.replace('NAME', column)}; a table is its columns",
            )

    def _check_power(self, node: ast.BinOp | ast.AugAssign) -> None:
        power = node.right if isinstance(node, ast.BinOp) else node.value
        constants = isinstance(node, ast.BinOp) and isinstance(node.left, ast.Constant)
        if not isinstance(power, ast.Constant) or not (constants or power.value == 2):
            raise self._origin.problem(
                node,
                "a power, whose last bits are not the same everywhere",
                "write x * x * x, math.sqrt(x) or portable.power(x, y)",
            )

    def _check_call(self, node: ast.Call) -> None:
        kernel = called(self._origin, node.func)
        if isinstance(kernel, Kernel):
            _check_arguments(self._origin, node, cast("Kernel[..., Any]", kernel))
            return
        if kernel is float and any(_is_text(each) for each in node.args):
            raise self._origin.problem(node, *TEXT_AS_NUMBER)
        if isinstance(node.func, ast.Attribute):
            self._check_name(node.func)
        check_called(self._origin, node)
        if kernel is not MISSING:  # as a kernel is that is defined below the rule
            for argument in node.args:
                self._check_whole(argument)


def _is_text(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def _check_arguments(origin: Origin, node: ast.Call, kernel: Kernel[..., Any]) -> None:
    if any(isinstance(argument, ast.Starred) for argument in node.args):
        return
    signature = inspect.signature(kernel.function)
    try:
        signature.bind(*node.args, **_keywords(node))
    except TypeError as error:
        names = ", ".join(signature.parameters)
        called_as = f"{kernel.__name__}({names})"
        raise origin.problem(node, f"this call: {error}", f"write {called_as}") from None


def _keywords(node: ast.Call) -> dict[str, Any]:
    return {str(each.arg): each.value for each in node.keywords}


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


_LOOPS: Final = (ast.For, ast.While)


def check_values(origin: Origin) -> None:
    """Raise NotCompilable at the first variable that may have no value."""
    arguments = origin.tree.args
    parameters = {each.arg for each in (*arguments.posonlyargs, *arguments.args)}
    stored = {
        node.id
        for node in ast.walk(origin.tree)
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
    }
    _Paths(origin, stored | parameters).block(origin.tree.body, parameters)


@dataclass(frozen=True, slots=True)
class _Paths:
    """Follows the paths through a function with these variables.

    `breaks` has, for each loop around a statement, the variables with a value at its breaks.
    """

    origin: Origin
    variables: set[str]
    breaks: list[set[str] | None] = field(default_factory=list[set[str] | None])

    def block(self, body: Iterable[ast.stmt], known: set[str] | None) -> set[str] | None:
        """The variables with a value after some statements; None if their end is not reached."""
        for node in body:
            if known is None:
                break
            known = self._after(node, known)
        return known

    def _after(self, node: ast.stmt, known: set[str]) -> set[str] | None:
        if isinstance(node, ast.If):
            self._read(node.test, known)
            return _both(self.block(node.body, {*known}), self.block(node.orelse, {*known}))
        if isinstance(node, _LOOPS):
            return self._after_loop(node, known)
        self._read(node, known)
        if isinstance(node, ast.Break):
            self.breaks[-1] = _both(self.breaks[-1], known)
        if isinstance(node, ast.Return | ast.Raise | ast.Break | ast.Continue):
            return None
        return known | _stored(node)

    def _after_loop(self, node: ast.For | ast.While, known: set[str]) -> set[str] | None:
        head = node.iter if isinstance(node, ast.For) else node.test
        self._read(head, known)
        self.breaks.append(None)
        inside = known | _stored(node.target) if isinstance(node, ast.For) else {*known}
        self.block(node.body, inside)
        left = self.breaks.pop()
        endless = isinstance(head, ast.Constant) and bool(head.value)
        return _both(left, None if endless else self.block(node.orelse, {*known}))

    def _read(self, node: ast.AST, known: set[str]) -> None:
        """Check the variables that an expression or a statement without others in it reads."""
        for each in ast.walk(node):
            if not isinstance(each, ast.Name) or each.id not in self.variables - known:
                continue
            if isinstance(each.ctx, ast.Load) or isinstance(node, ast.AugAssign):
                raise self.origin.problem(
                    each,
                    f"{each.id} may have no value here",
                    f"assign {each.id} before the branch or loop that sets it",
                )


def _stored(node: ast.AST) -> set[str]:
    if isinstance(node, ast.AnnAssign) and node.value is None:
        return set()
    names = [each for each in ast.walk(node) if isinstance(each, ast.Name)]
    return {each.id for each in names if isinstance(each.ctx, ast.Store)}


def _both(first: set[str] | None, other: set[str] | None) -> set[str] | None:
    """The variables with a value on both of two paths, of which None is not reached."""
    if first is None or other is None:
        return other if first is None else first
    return first & other


def only_read(function: FunctionType, names: Collection[str]) -> frozenset[str]:
    """Those of these parameters of which a function only reads items (`grass[cell]`) or `len`."""
    try:
        origin = Origin.of(function)
    except NotCompilable:  # such as a rule without source
        return frozenset()
    reading = {id(node) for each in ast.walk(origin.tree) for node in _read(origin, each)}
    used = [node for node in ast.walk(origin.tree) if isinstance(node, ast.Name)]
    changed = {node.id for node in used if id(node) not in reading}
    return frozenset(names) - changed


def _read(origin: Origin, node: ast.AST) -> list[ast.AST]:
    """The parts of a node that are only read, if they are names."""
    if isinstance(node, ast.Subscript) and isinstance(node.ctx, ast.Load):
        return [node.value]
    if isinstance(node, ast.Call) and called(origin, node.func) is len:
        return [*node.args]
    return []
