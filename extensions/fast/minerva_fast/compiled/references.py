"""Names and attributes in a compiled method: what they refer to, and the values that they have."""

from __future__ import annotations

import ast
import inspect
from types import FunctionType, ModuleType
from typing import Any, Final

from minerva_bus.errors import nearest
from minerva_bus.grammar.symbols import EventType
from minerva_bus.world.accelerator import NotCompilable
from minerva_fast.compiled.form import (
    Constant,
    Expression,
    Item,
    ValueKind,
    Variable,
)
from minerva_fast.compiled.names import (
    AgentItself,
    BoundMethod,
    Chance,
    EventItself,
    Known,
    LocalNames,
    Method,
    Moment,
    Reference,
    kind_of,
)
from minerva_fast.compiled.origin import MISSING

INT_BITS: Final = 2**63
"""Ints of machine code are below this."""


class References:
    """Resolves the names of one function."""

    def __init__(self, method: Method, scope: LocalNames) -> None:
        self.method = method
        self.scope = scope

    def problem(self, node: ast.AST, what: str, instead: str = "") -> NotCompilable:
        """The error of a part of the function."""
        return self.scope.origin.problem(node, what, instead)

    def value(self, node: ast.expr) -> Expression:
        """The checked form of an expression."""
        raise NotImplementedError

    def text(self, text: str) -> Constant:
        """A constant text as its code."""
        return Constant(ValueKind.TEXT, self.method.code(text))

    def reference(self, node: ast.expr) -> Reference | None:
        """What a name refers to if it is not a value that is known only when the kernel runs."""
        if isinstance(node, ast.Name):
            return self._reference_of_name(node)
        if isinstance(node, ast.Attribute):
            base = self.reference(node.value)
            if isinstance(base, AgentItself):
                return self._of_class(node)
            if isinstance(base, Moment) and node.attr == "chance":
                return Chance()
            if isinstance(base, Known) and self._has_names(base.value):
                inner = self.method.attribute_of(base.value, node.attr)
                if inner is MISSING:
                    raise self.problem(node, f"{ast.unparse(node)} does not exist")
                return Known(inner)
        return None

    def _has_names(self, value: Any) -> bool:
        """Whether an object is a module or a class, whose attributes are constants."""
        return isinstance(value, ModuleType | type)

    def _reference_of_name(self, node: ast.Name) -> Reference | None:
        scope = self.scope
        if node.id in scope.references:
            return scope.references[node.id]
        if self._is_local(node.id):
            return None
        value = self.method.known(scope.origin, node.id)
        if value is not MISSING:
            return Known(value)
        # The class itself has no name yet while it is made.
        if node.id == self.method.cls.__name__:
            return Known(self.method.cls)
        raise self.problem(
            node,
            f"{node.id} is not defined when the class is made",
            f"define {node.id} above the class",
        )

    def _is_local(self, name: str) -> bool:
        code = self.scope.origin.function.__code__
        return name in code.co_varnames or name in code.co_cellvars

    def _of_class(self, node: ast.Attribute) -> Reference | None:
        """A constant or a method of the agent's class."""
        if node.attr in self.method.types or node.attr in ("id", "scope", "string", "child"):
            return None
        value = self.method.attribute_of(self.method.cls, node.attr)
        if value is MISSING:
            return None
        # Found on the class, a static method is a plain function, too, but takes no agent.
        static = isinstance(inspect.getattr_static(self.method.cls, node.attr), staticmethod)
        bound = isinstance(value, FunctionType) and not static
        return BoundMethod(value) if bound else Known(value)

    def _name(self, node: ast.Name) -> Expression:
        reference = self.reference(node)
        if isinstance(reference, Known):
            return self._frozen(node, reference.value)
        if reference is not None:
            raise self.problem(node, f"{node.id} as a value", "use its attributes")
        return self.variable(node)

    def variable(self, node: ast.Name) -> Expression:
        """The value of a local variable, which must have one on every path."""
        name, scope = node.id, self.scope
        if name in scope.lists:
            raise self.problem(node, f"the list {name} as a value", f"use its items: {name}[0]")
        if name in scope.litters:
            raise self.problem(node, f"{name} holds newborns here", f"return self.string + {name}")
        if scope.assigned is not None and name not in scope.assigned:
            raise self.problem(
                node,
                f"{name} may have no value here",
                f"assign {name} before the branch or loop that sets it",
            )
        # Not known yet in the first pass over a loop.
        return Variable(scope.kinds.get(name, ValueKind.INT), f"v_{name}")

    def _frozen(self, node: ast.expr, value: Any) -> Expression:
        """A constant of the module or class."""
        constant = self.constant_of(value)
        if type(value) is int and constant is None:
            raise self.problem(
                node, "an int of more than 64 bits", "write a real number, such as 1e20"
            )
        if constant is None:
            raise self.problem(
                node,
                f"{ast.unparse(node)} is a {type(value).__name__}, not a number, bool or text",
                "use constants, attributes of self, data of the event, or local variables",
            )
        return constant

    def constant_of(self, value: Any) -> Constant | None:
        """A Python object as a constant; None if it is not a number, bool or text."""
        if isinstance(value, bool):
            return Constant(ValueKind.BOOL, value)
        if type(value) is int and -INT_BITS <= value < INT_BITS:
            return Constant(ValueKind.INT, value)
        if type(value) is float:
            return Constant(ValueKind.REAL, value)
        return self.text(value) if type(value) is str else None

    def _constant(self, node: ast.Constant) -> Expression:
        constant = self.constant_of(node.value)
        if constant is not None:
            return constant
        if isinstance(node.value, int):
            raise self.problem(node, "an int of more than 64 bits", "use a real number: 1e20")
        what = "None" if node.value is None else f"a {type(node.value).__name__}"
        raise self.problem(node, f"{what} as a value", "use a number, a bool or a text")

    # --- attributes ---

    def _attribute(self, node: ast.Attribute) -> Expression:
        base = self.reference(node.value)
        if isinstance(base, AgentItself):
            return self._of_agent(node)
        if isinstance(base, EventItself):
            return self._of_event(node, base)
        if isinstance(base, Moment):
            return self._of_moment(node)
        reference = self.reference(node)
        if isinstance(reference, Known):
            return self._frozen(node, reference.value)
        if isinstance(base, Known) and not isinstance(base.value, ModuleType | type):
            raise self.problem(
                node,
                f"the attribute {node.attr} of {ast.unparse(node.value)}",
                "assign it to a constant at the top of the module",
            )
        raise self.problem(node, f"the attribute {node.attr} of a value", "compute it otherwise")

    def _of_agent(self, node: ast.Attribute) -> Expression:
        name = node.attr
        if name in self.method.types:
            return self.attribute(name)
        if name == "id":
            return self.given("id", ValueKind.TEXT)
        if name == "scope":
            raise self.problem(node, "self.scope", "agents with scopes evolve agent by agent")
        if name in ("string", "child"):
            raise self.problem(
                node, f"self.{name} here", "return self.string + self.child(...) at the end"
            )
        reference = self._of_class(node)
        if isinstance(reference, Known):
            return self._frozen(node, reference.value)
        if isinstance(reference, BoundMethod):
            raise self.problem(node, f"the method {name} as a value", f"call it: self.{name}()")
        known = list(self.method.types)
        near = nearest(name, known)
        raise self.problem(
            node,
            f"{self.method.cls.__name__} has no attribute {name}{near}",
            f"declare {name} in the class, or use a local variable",
        )

    def attribute(self, name: str) -> Expression:
        """The value of an attribute of the agent."""
        self.method.reads[name] = None
        return self._passed(Variable(self.method.kinds[name], f"a_{name}"))

    def given(self, name: str, kind: ValueKind) -> Expression:
        """A value that the kernel is passed."""
        self.method.given[name] = kind
        return self._passed(Variable(kind, f"g_{name}"))

    def _passed(self, variable: Variable) -> Variable:
        self.scope.reads[variable.name] = variable
        return variable

    def _of_moment(self, node: ast.Attribute) -> Expression:
        name = node.attr
        if name in ("dt", "time"):
            return self.given(name, ValueKind.REAL)
        if name == "number":
            return self.given(name, ValueKind.INT)
        if name == "random":
            raise self.problem(node, "moment.random", "draw from moment.chance")
        if name == "chance":
            raise self.problem(
                node, "moment.chance as a value", "write it in each draw: moment.chance.random()"
            )
        raise self.problem(node, f"moment.{name} as a value", "use dt, time, number and chance")

    def _of_event(self, node: ast.Attribute, event: EventItself) -> Expression:
        name = node.attr
        if event.batch:
            raise self.problem(
                node, "an array with the data of all events", "loop over them: for each in events"
            )
        if name == "sender":
            self.method.given["sender"] = ValueKind.TEXT
            return Item(ValueKind.TEXT, "g_sender", 0, event.place)
        declared = self.method.event_type
        if declared is None:
            raise self.problem(
                node,
                "the types of this event's data are not known",
                "define or import the event type in the module of this class",
            )
        return self._datum(node, event, declared)

    def _datum(self, node: ast.Attribute, event: EventItself, declared: EventType) -> Expression:
        name = node.attr
        types = {datum.name: datum.type for datum in declared.fields.all}
        if name not in types:
            listed = ", ".join(types) or "no data"
            raise self.problem(node, f"{declared.name} has no {name}", f"it has {listed}")
        kind = kind_of(types[name])
        if kind is None:
            raise self.problem(
                node,
                f"{declared.name}.{name} is a {types[name]}",
                "send numbers, bools and texts",
            )
        self.method.data[name] = kind
        return Item(kind, f"d_{name}", 0, event.place)
