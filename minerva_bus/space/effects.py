"""Whether a method of a space provably has no effect except on the space itself.

Such a method may run for a frame that proves to have other events, and then again. The check reads
the source of the method and of the functions that it calls. All that it does not recognize counts
as an effect: `emit`, `print`, changes of objects that other code has, unknown calls.
"""

from __future__ import annotations

import ast
import builtins
import inspect
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from types import FunctionType, ModuleType
from typing import Any, Final, cast

import numpy as np

from minerva_bus.compiled.origin import MISSING, NotCompilable, Origin, lookup
from minerva_bus.compiled.sources import is_portable
from minerva_bus.grammar.scene import Scene
from minerva_bus.space.kernels import Kernel
from minerva_bus.space.rules import SpaceRule
from minerva_bus.space.tables import Inhabitants

_NODES: Final = (
    ast.Assign, ast.AugAssign, ast.AnnAssign, ast.Expr, ast.If, ast.For, ast.While, ast.Break,
    ast.Continue, ast.Pass, ast.Return, ast.Constant, ast.Name, ast.Attribute, ast.Subscript,
    ast.Slice, ast.Starred, ast.Tuple, ast.List, ast.BinOp, ast.UnaryOp, ast.BoolOp, ast.Compare,
    ast.IfExp, ast.Call, ast.keyword, ast.ListComp, ast.GeneratorExp, ast.comprehension,
    ast.expr_context, ast.operator, ast.unaryop, ast.boolop, ast.cmpop,
)  # fmt: skip
"""Statements and expressions without an effect but assignments and calls, which are checked."""
_OF_PYTHON: Final = (
    "abs", "all", "any", "bool", "divmod", "enumerate", "float", "int", "len", "list", "max",
    "min", "range", "reversed", "round", "sum", "tuple", "zip",
)  # fmt: skip
_OF_NUMPY: Final = (
    "all", "any", "arange", "argmax", "argmin", "argsort", "array", "average", "bincount",
    "concatenate", "corrcoef", "count_nonzero", "cumsum", "diff", "dot", "flatnonzero", "full",
    "histogram", "linspace", "max", "mean", "median", "min", "nonzero", "ones", "percentile",
    "prod", "quantile", "ravel", "repeat", "reshape", "roll", "sort", "stack", "std", "sum",
    "take", "unique", "var", "where", "zeros",
)  # fmt: skip
_PURE: Final = (
    *[getattr(builtins, name) for name in _OF_PYTHON],
    *[getattr(np, name) for name in _OF_NUMPY],
    *[each for each in vars(math).values() if callable(each)],
)
_METHODS: Final = (
    "all", "any", "argmax", "argmin", "argsort", "astype", "copy", "cumsum", "dot", "item", "max",
    "mean", "min", "nonzero", "prod", "ravel", "repeat", "reshape", "round", "std", "sum", "take",
    "tolist", "var",
)  # fmt: skip
"""Methods of arrays; no other object in such a method has these names."""
_DRAWS: Final = frozenset(("chance", "exponential", "integers", "normal", "random", "uniform"))
_OF_MOMENT: Final = frozenset(("chance", "dt", "number", "time"))
_VALUES: Final = (bool, int, float, complex, str, bytes, Scene, type(None))
"""Types of constants that no method can change."""


def has_no_effects(cls: Any, method: Callable[..., Any]) -> bool:
    """Whether a method of a space, with all that it calls, provably changes the space only."""
    try:
        _check(method, cls, set(), ("self", "event", "moment"))
    except NotCompilable:  # also if there is no source
        return False
    return True


def _check(
    function: Callable[..., Any], cls: Any, known: set[Any], roles: tuple[str, ...] = ()
) -> None:
    """Check a function; `roles` are those of its parameters.

    Raises NotCompilable if it may have an effect, or if its source cannot be read.
    """
    if function in known:
        return
    known.add(function)
    origin = Origin.of(function)
    arguments, given = origin.tree.args, cast("FunctionType", function)
    names = [each.arg for each in (*arguments.posonlyargs, *arguments.args)]
    # Defaults may be objects that live on.
    if given.__defaults__ or arguments.kwonlyargs or arguments.vararg or arguments.kwarg:
        raise NotCompilable
    by_role = dict(zip(roles, names, strict=False))
    body = _Body(origin, cls, known, by_role.get("self", ""), by_role.get("moment", ""))
    body.local.update(names)
    body.check()


@dataclass(slots=True)
class _Body:
    """A function; `space` and `moment` are its parameters that are these, `local` all variables."""

    origin: Origin
    cls: Any
    known: set[Any]
    space: str
    moment: str
    local: set[str] = field(default_factory=set[str])

    def check(self) -> None:
        """Raise NotCompilable for a statement or expression that may have an effect."""
        body = self.origin.tree.body
        for node in (each for statement in body for each in ast.walk(statement)):
            if not isinstance(node, _NODES):
                raise NotCompilable
            if isinstance(node, ast.Name) and not isinstance(node.ctx, ast.Load):
                if node.id in (self.space, self.moment):
                    raise NotCompilable
                self.local.add(node.id)
        self._visit_all(body)

    def _visit_all(self, nodes: Iterable[ast.AST | None]) -> None:
        for node in nodes:
            if node is not None:
                self._visit(node)

    def _visit(self, node: ast.AST) -> None:
        match node:
            case ast.Call():
                self._call(node)
            case ast.Name(id=name):
                # `moment` itself would give access to `emit`, and the space to its properties.
                if name in (self.moment, self.space):
                    raise NotCompilable
                if name not in self.local and not self._is_constant(node):
                    raise NotCompilable
            case ast.Attribute():
                self._attribute(node)
            case ast.Subscript(value=base) if not isinstance(node.ctx, ast.Load):
                if not isinstance(base, ast.Name):
                    raise NotCompilable
                self._visit_all((base, node.slice))
            case ast.AnnAssign():  # whose annotation is not evaluated
                self._visit_all((node.target, node.value))
            case _:
                self._visit_all(ast.iter_child_nodes(node))

    def _attribute(self, node: ast.Attribute) -> None:
        name, base, loads = node.attr, node.value, isinstance(node.ctx, ast.Load)
        if _is(base, self.space):
            # A property may do anything.
            permitted = name in self.cls.kind.fields.names
        elif _is(base, self.moment):
            permitted = loads and name in _OF_MOMENT
        else:
            permitted = loads and not name.startswith("_")
            if permitted and not self._is_constant(node):
                self._visit(base)
        if not permitted:
            raise NotCompilable

    def _is_constant(self, node: ast.AST) -> bool:
        return _is_fixed(self._static(node))

    def _static(self, node: ast.AST) -> Any:
        """The object of a global name, or of one of a module or table; MISSING for others."""
        if isinstance(node, ast.Name) and node.id not in self.local:
            return lookup(self.origin.function, node.id)
        if isinstance(node, ast.Attribute):
            owner = self._static(node.value)
            if isinstance(owner, ModuleType) or _is_table(owner):
                return getattr(owner, node.attr, MISSING)
        return MISSING

    def _call(self, node: ast.Call) -> None:
        function, named = node.func, [each.value for each in node.keywords]
        if any(each.arg in (None, "out") for each in node.keywords):
            raise NotCompilable
        if isinstance(function, ast.Attribute) and _is(function.value, self.space):
            self._visit_all(named)
            self._visit_all(self._of_space(function.attr, node))
            return
        if isinstance(function, ast.Attribute) and self._static(function) is MISSING:
            self._method(function.value, function.attr)
        else:
            self._check_pure(self._static(function))
        self._visit_all((*node.args, *named))

    def _of_space(self, name: str, node: ast.Call) -> list[ast.expr]:
        """Check a method of the space; returns the arguments that are values."""
        method = inspect.getattr_static(self.cls, name, None)
        module: str = getattr(method, "__module__", "")
        if module == "minerva_bus.space.space" and name == "run" and node.args:
            context, *rules = node.args
            # Rules change their space only.
            if not _is(context, self.moment) or not all(map(self._is_rule, rules)):
                raise NotCompilable
            return []
        if (module, name) != ("minerva_bus.world.agent", "writable"):
            if not isinstance(method, FunctionType) or module.startswith("minerva_bus."):
                raise NotCompilable
            _check(method, self.cls, self.known, ("self",))
        return node.args

    def _is_rule(self, node: ast.expr) -> bool:
        value = self._static(node.value if isinstance(node, ast.Starred) else node)
        rules: Any = value if isinstance(node, ast.Starred) else (value,)
        return isinstance(rules, tuple) and all(map(_is_quiet, cast("tuple[Any, ...]", rules)))

    def _method(self, base: ast.expr, name: str) -> None:
        """Check a method of an array, a number, or the random numbers."""
        of_chance = (
            isinstance(base, ast.Attribute)
            and base.attr == "chance"
            and _is(base.value, self.moment)
        )
        if name not in (_DRAWS if of_chance else _METHODS):
            raise NotCompilable
        self._visit(base)

    def _check_pure(self, function: Any) -> None:
        owner = getattr(function, "__self__", None)
        if is_portable(function) or isinstance(function, np.ufunc) or _is_number_type(function):
            return
        if _is_table(owner) and function.__func__.__module__ == Inhabitants.__module__:
            return
        if not any(function is each for each in _PURE):
            if not isinstance(function, FunctionType) or function.__module__.startswith("minerva"):
                raise NotCompilable
            _check(function, self.cls, self.known)


def _is(node: ast.AST, name: str) -> bool:
    return bool(name) and isinstance(node, ast.Name) and node.id == name


def _is_table(value: Any) -> bool:
    """Whether this is a class of inhabitants without methods and properties of its own."""
    return (
        isinstance(value, type)
        and issubclass(value, Inhabitants)
        and not any(
            isinstance(each, (FunctionType, property, classmethod, staticmethod))
            for base in value.__mro__
            if base.__module__ != Inhabitants.__module__
            for each in vars(base).values()
        )
    )


def _is_fixed(value: Any) -> bool:
    """Whether an object is a constant that nothing can change, or a type of numbers."""
    if isinstance(value, tuple):
        return all(map(_is_fixed, cast("tuple[Any, ...]", value)))
    return _is_number_type(value) or isinstance(value, _VALUES)


def _is_number_type(value: Any) -> bool:
    return isinstance(value, type) and (
        value in (bool, int, float)
        or (issubclass(value, np.generic) and value.__module__ == np.__name__)
    )


def _is_quiet(rule: Any) -> bool:
    """Whether this is a rule that, with the kernels that it calls, prints nothing."""
    if not isinstance(rule, SpaceRule):
        return False
    kernels: list[Kernel[..., Any]] = [rule.kernel, *rule.kernel.called]
    return not any(
        lookup(each.function, name) is print
        for each in kernels
        for name in each.function.__code__.co_names
    )
