"""Calls of functions and methods of user code in a compiled method: each becomes a helper."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Mapping
from types import FunctionType
from typing import Any, Final

from minerva_fast.compiled.assignments import Assignments
from minerva_fast.compiled.form import (
    Call,
    Expression,
    Helper,
    Slot,
    Statement,
    ValueKind,
    Variable,
)
from minerva_fast.compiled.names import (
    ROW,
    STATE,
    WORDS,
    BoundMethod,
    EventItself,
    Known,
    LocalNames,
    Method,
    Reference,
)
from minerva_fast.compiled.origin import Origin

_VARIABLE: Final = inspect.CO_VARARGS | inspect.CO_VARKEYWORDS


class HelperCalls(Assignments):
    """Checks the calls of user code in one function."""

    def checked(self, method: Method, scope: LocalNames) -> list[Statement]:
        """The checked statements of a function that is called."""
        raise NotImplementedError

    def helper(
        self, node: ast.Call, function: FunctionType, bound: tuple[Reference, ...]
    ) -> Expression:
        if function.__code__.co_flags & _VARIABLE:
            what = f"{function.__name__}, a function with * or **, as decorators make"
            raise self.problem(node, what, "call a function with a parameter for each argument")
        arguments = [*bound, *(self._argument(argument) for argument in node.args)]
        named = {str(word.arg): self._argument(word.value) for word in node.keywords}
        try:
            call = inspect.signature(function).bind(*arguments, **named)
        except TypeError as error:
            raise self.problem(node, f"this call of {function.__name__}: {error}") from None
        # Python evaluates arguments in the order in which they are written, and draws are in it.
        order = [*list(call.arguments)[: len(arguments)], *named]
        call.apply_defaults()
        order += [name for name in call.arguments if name not in order]
        given = {name: self._plain(node, call.arguments[name]) for name in order}
        made = self._made(node, function, given)
        passed = [self._passed_on(slot, given) for slot in made.parameters]
        return Call(made.kind, made.name, (STATE, WORDS, ROW, *passed))

    def _passed_on(self, slot: Slot, given: Mapping[str, Any]) -> Expression:
        """An argument of a helper: a value of the call, or an attribute that the helper reads."""
        name = slot.name.removeprefix("v_")
        if slot.name.startswith("v_") and name in given:
            value: Expression = given[name]
            return self.as_mixed(value) if slot.kind is ValueKind.MIXED else value
        return self._passed(Variable(slot.kind, slot.name))

    def _argument(self, node: ast.expr) -> Any:
        reference = self.reference(node) if isinstance(node, ast.Name | ast.Attribute) else None
        if reference is not None and not isinstance(reference, Known | BoundMethod):
            return reference
        return self.value(node)

    def _plain(self, node: ast.Call, value: Any) -> Any:
        """An argument; default values are constants."""
        if isinstance(value, EventItself):
            raise self.problem(node, "the event as an argument", "pass the data that are needed")
        if isinstance(value, Reference | Expression):
            return value
        constant = self.constant_of(value)
        if constant is None:
            raise self.problem(node, f"the argument {value!r}", "pass numbers, bools or texts")
        return constant

    def _made(self, node: ast.Call, function: FunctionType, given: Mapping[str, Any]) -> Helper:
        """The helper for arguments of these kinds."""
        method = self.method
        key = (
            function,
            tuple(
                (name, value if isinstance(value, Reference) else value.kind)
                for name, value in given.items()
            ),
        )
        if function in method.calling:
            raise self.problem(node, "a function that calls itself", "write a loop")
        if key in method.helpers:
            return method.helpers[key]
        method.calling.append(function)
        references = {n: v for n, v in given.items() if isinstance(v, Reference)}
        kinds = {n: v.kind for n, v in given.items() if not isinstance(v, Reference)}
        origin = Origin.of(function)
        scope = LocalNames(origin, references, dict(kinds), assigned=set(kinds), helper=True)
        body = self.checked(method, scope)
        method.calling.remove(function)
        slots = [Slot(f"v_{name}", scope.kinds[name]) for name in kinds]
        slots += [Slot(name, each.kind) for name, each in sorted(scope.reads.items())]
        name = f"h{len(method.helpers)}_{function.__name__}"
        made = Helper(name, tuple(slots), scope.result or ValueKind.INT, body)
        method.helpers[key] = made
        return made
