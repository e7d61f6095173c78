"""Expressions of a compiled method: what names refer to, and Python's results or a fault.

Names and attributes, arithmetic for numbers of two kinds, sequences of fixed length (local lists
and tuples of constants), comparisons, calls, and draws of `moment.chance`.
"""

from __future__ import annotations

import ast
import inspect
from collections.abc import Callable, Sequence
from functools import partial
from types import FunctionType, ModuleType
from typing import Any, Final, TypeAlias, cast

from minerva_bus.errors import nearest
from minerva_bus.grammar.scene import Scene
from minerva_bus.grammar.vocabulary import EventType
from minerva_bus.world.class_declaration import NotCompilable
from minerva_fast.compiled.form import (
    BinaryOperation,
    Call,
    Choice,
    Constant,
    Expression,
    Item,
    Logic,
    UnaryOperation,
    ValueKind,
    Variable,
)
from minerva_fast.compiled.functions import DISTRIBUTIONS, FUNCTIONS, Distribution, instead_of
from minerva_fast.compiled.names import (
    ROW,
    STATE,
    WORDS,
    AgentItself,
    BoundMethod,
    Chance,
    EventItself,
    Known,
    LocalNames,
    Method,
    Moment,
    Reference,
    joined,
    kind_of,
)
from minerva_fast.compiled.origin import CHOICES, EXPRESSIONS, MISSING, REAL_EVERYWHERE

INT_BITS: Final = 2**63
"""Ints of machine code are below this."""
_EXACT: Final = 2**53
_WITH_FAULTS: Final[dict[type[ast.operator], tuple[str, ValueKind]]] = {
    ast.Add: ("add", ValueKind.INT),
    ast.Sub: ("subtract", ValueKind.INT),
    ast.Mult: ("multiply", ValueKind.INT),
    ast.Div: ("divide_ints", ValueKind.REAL),
    ast.FloorDiv: ("floor_divide", ValueKind.INT),
    ast.Mod: ("modulo", ValueKind.INT),
    ast.Pow: ("power_of_ints", ValueKind.INT),
    ast.LShift: ("shift_left", ValueKind.INT),
    ast.RShift: ("shift_right", ValueKind.INT),
}
"""Operators of two ints: a function of `library`, and the kind of its result."""
_BITS: Final[dict[type[ast.operator], str]] = {ast.BitAnd: "&", ast.BitOr: "|", ast.BitXor: "^"}
_PLAIN: Final[dict[type[ast.operator], str]] = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*"}
_OF_REALS: Final[dict[type[ast.operator], str]] = {
    ast.Div: "divide",
    ast.FloorDiv: "floor_divide_reals",
    ast.Mod: "modulo_reals",
    ast.Pow: "power",
}
_OF_MIXED: Final[dict[type[ast.operator], str]] = {
    ast.Add: "add_mixed",
    ast.Sub: "subtract_mixed",
    ast.Mult: "multiply_mixed",
    ast.FloorDiv: "floor_divide_mixed",
    ast.Mod: "modulo_mixed",
    ast.Pow: "power_mixed",
}
"""Operators of two numbers of which both may be ints and one may be a real."""
_TABLE: Final = 10_000
Nested: TypeAlias = "Constant | tuple[Nested, ...]"
"""A constant, or a tuple of constants, or of such tuples."""
Column: TypeAlias = tuple[ast.expr, str, ValueKind, int]
"""A name that takes the items of a sequence in turn: the sequence, its kind and its length."""
_COMPARISONS: Final[dict[type[ast.cmpop], str]] = {
    ast.Eq: "==",
    ast.NotEq: "!=",
    ast.Lt: "<",
    ast.LtE: "<=",
    ast.Gt: ">",
    ast.GtE: ">=",
}


class Expressions:
    """Checks the expressions of one function."""

    def __init__(self, method: Method, scope: LocalNames) -> None:
        self.method = method
        self.scope = scope
        self._checks: dict[type[ast.AST], Callable[[Any], Expression]] = {
            ast.Constant: self._constant,
            ast.Name: self._name,
            ast.Attribute: self._attribute,
            ast.BinOp: self._operation,
            ast.UnaryOp: self._unary,
            ast.BoolOp: self._logic,
            ast.Compare: self._comparison,
            ast.IfExp: self._choice,
            ast.Call: self._call,
            ast.Subscript: self._item,
        }

    # --- names ---

    def problem(self, node: ast.AST, what: str, instead: str = "") -> NotCompilable:
        """The error of a part of the function."""
        return self.scope.origin.problem(node, what, instead)

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

    # --- arithmetic ---

    def truth(self, node: ast.expr) -> Expression:
        """An expression as a condition."""
        if isinstance(node, ast.BoolOp):
            operator = "and" if isinstance(node.op, ast.And) else "or"
            return Logic(operator, tuple(map(self.truth, node.values)))
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            return UnaryOperation(ValueKind.BOOL, "not", self.truth(node.operand))
        return self.as_truth(self.value(node))

    def as_truth(self, value: Expression) -> Expression:
        """Whether a value counts as true."""
        if value.kind is ValueKind.BOOL:
            return value
        empty = Constant(value.kind, 0 if value.kind is ValueKind.INT else 0.0)
        if value.kind is ValueKind.TEXT:
            empty = self.text("")
        return BinaryOperation(ValueKind.BOOL, "!=", value, empty)

    def fault(self, kind: ValueKind, function: str, *arguments: Expression) -> Expression:
        """A call of a function of `library` that marks the row if Python has no such result."""
        return Call(kind, function, (STATE, *arguments))

    def as_number(self, node: ast.AST, value: Expression) -> Expression:
        """A number; a bool counts as 0 or 1, as in Python."""
        if value.kind is ValueKind.BOOL:
            return Call(ValueKind.INT, "int", (value,))
        if value.kind is ValueKind.TEXT:
            raise self.problem(node, "arithmetic with a text", "compare texts with == or != only")
        return value

    def as_real(self, value: Expression) -> Expression:
        """A number as Python converts it to a real."""
        if value.kind is not ValueKind.INT:
            return value
        if isinstance(value, Constant):
            return Constant(ValueKind.REAL, float(value.value))
        return Call(ValueKind.REAL, "float", (value,))

    def as_mixed(self, value: Expression) -> Expression:
        """A number held as a real, of which an int has no other digits."""
        if value.kind is not ValueKind.INT:
            return value
        if isinstance(value, Constant) and abs(value.value) <= _EXACT:
            return Constant(ValueKind.MIXED, float(value.value))
        return self.fault(ValueKind.MIXED, "exact", value)

    def alike(
        self, node: ast.AST, values: Sequence[Expression]
    ) -> tuple[ValueKind, list[Expression]]:
        """Values converted to one kind."""
        kind: ValueKind | None = values[0].kind
        for value in values[1:]:
            kind = joined(kind, value.kind) if kind is not None else None
        if kind is None:
            kinds = " and ".join(sorted({value.kind.value for value in values}))
            raise self.problem(node, f"{kinds} in one place", "use one type")
        return kind, [self.as_mixed(each) if kind is ValueKind.MIXED else each for each in values]

    def _operation(self, node: ast.BinOp) -> Expression:
        return self.of_values(node, node.op, self.value(node.left), self.value(node.right))

    def of_values(
        self, node: ast.AST, operator: ast.operator, left: Expression, right: Expression
    ) -> Expression:
        """The result of an operator between two values."""
        both = left.kind is right.kind is ValueKind.BOOL
        if both and type(operator) in _BITS:  # a bool in Python, and an int here
            raise self.problem(node, "an operator on bits of bools", "write and, or, or !=")
        return self.operation(
            node, operator, self.as_number(node, left), self.as_number(node, right)
        )

    def operation(
        self, node: ast.AST, operator: ast.operator, left: Expression, right: Expression
    ) -> Expression:
        """The result of an operator between two numbers."""
        kinds = {left.kind, right.kind}
        if isinstance(operator, ast.MatMult):
            raise self.problem(node, "the operator @", "write the products")
        if kinds == {ValueKind.INT}:
            return self._of_ints(node, operator, left, right)
        if ValueKind.REAL not in kinds and not isinstance(operator, ast.Div):
            return self._of_mixed(node, operator, left, right)
        return self._of_reals(node, operator, left, right)

    def _of_mixed(
        self, node: ast.AST, operator: ast.operator, left: Expression, right: Expression
    ) -> Expression:
        """The result of an operator that is an int if both numbers are ints, and else a real."""
        function = _OF_MIXED.get(type(operator))
        if function is None:
            raise self.problem(node, "an operator on bits of a real", "convert with int(...)")
        # An int to the power of a negative int is a real.
        if isinstance(operator, ast.Pow) and not (isinstance(right, Constant) and right.value >= 0):
            raise self.mixed(node, left, right)
        return self.fault(ValueKind.MIXED, function, self.as_mixed(left), self.as_mixed(right))

    def mixed(self, node: ast.AST, *values: Expression) -> NotCompilable:
        """The error of arithmetic whose result depends on whether a number is an int."""
        lines = {**self.method.int_lines, **self.scope.int_lines}
        known = [
            f"{value.name[2:]} is set to an int in line {lines[value.name]}; "
            for value in values
            if isinstance(value, Variable) and value.name in lines
        ]
        return self.problem(
            node,
            "a number here is an int in one case and a real in another",
            "".join(known[:1]) + REAL_EVERYWHERE,
        )

    def _of_ints(
        self, node: ast.AST, operator: ast.operator, left: Expression, right: Expression
    ) -> Expression:
        if type(operator) in _BITS:
            return BinaryOperation(ValueKind.INT, _BITS[type(operator)], left, right)
        if isinstance(operator, ast.Pow) and not (isinstance(right, Constant) and right.value >= 0):
            raise self.problem(
                node,
                "a power of ints whose exponent is not a constant from 0 up",
                "make the base a real number: float(n) ** k",
            )
        function, kind = _WITH_FAULTS[type(operator)]
        return self.fault(kind, function, left, right)

    def _of_reals(
        self, node: ast.AST, operator: ast.operator, left: Expression, right: Expression
    ) -> Expression:
        # Python rounds an int to a real for + - * and //; a quotient of two ints is rounded once.
        quotient = isinstance(operator, ast.Div) and ValueKind.REAL not in (left.kind, right.kind)
        convert = self.as_mixed if quotient else self.as_real
        left, right = convert(left), convert(right)
        if type(operator) in _PLAIN:
            return BinaryOperation(ValueKind.REAL, _PLAIN[type(operator)], left, right)
        function = _OF_REALS.get(type(operator))
        if function is None:
            raise self.problem(node, "an operator on bits of a real", "convert with int(...)")
        return self.fault(ValueKind.REAL, function, left, right)

    def _unary(self, node: ast.UnaryOp) -> Expression:
        if isinstance(node.op, ast.Not):
            return self.truth(node)
        operand = self.as_number(node.operand, self.value(node.operand))
        if isinstance(node.op, ast.UAdd):
            return operand
        if isinstance(node.op, ast.Invert):
            if operand.kind is not ValueKind.INT:
                raise self.problem(node, "~ of a real", "convert with int(...)")
            return BinaryOperation(ValueKind.INT, "^", operand, Constant(ValueKind.INT, -1))
        return self.negative(node, operand)

    def negative(self, node: ast.AST, operand: Expression) -> Expression:
        """The negative of a number."""
        if isinstance(operand, Constant) and operand.value > -INT_BITS:
            return Constant(operand.kind, -operand.value)
        if operand.kind is ValueKind.MIXED:
            return self._of_mixed(node, ast.Mult(), operand, Constant(ValueKind.INT, -1))
        if operand.kind is ValueKind.INT:
            return self.fault(ValueKind.INT, "subtract", Constant(ValueKind.INT, 0), operand)
        return UnaryOperation(ValueKind.REAL, "-", operand)

    # --- sequences ---

    def _item(self, node: ast.Subscript) -> Expression:
        sequence = self.sequence(node.value)
        if sequence is None:
            raise self.problem(
                node, "an item of this value", "index a constant tuple or a local list of numbers"
            )
        name, kind, length = sequence
        return Item(kind, name, length, self.index(node, length))

    def index(self, node: ast.Subscript, length: int) -> Expression:
        """An index, counted from the start."""
        if isinstance(node.slice, ast.Slice | ast.Tuple):
            raise self.problem(node, "a slice", "write a for loop over the index")
        index = self.value(node.slice)
        if index.kind is not ValueKind.INT:
            raise self.problem(node.slice, f"{index.kind.value} as an index", "use an int")
        return self.fault(ValueKind.INT, "place", index, Constant(ValueKind.INT, length))

    def sequence(self, node: ast.expr) -> tuple[str, ValueKind, int] | None:
        """The variable, kind of items and length of a local list or a constant tuple."""
        if isinstance(node, ast.Name) and node.id in self.scope.lists:
            known = self.scope.lists[node.id]
            return f"l_{known.name}", known.kind, known.length
        constant = self._constant_tuple(node)
        return None if constant is None else self._table(node, self._nested(node, constant))

    def columns(self, node: ast.expr, target: ast.expr) -> list[Column] | None:
        """The names of a loop with the sequences that they go over; None if there are none."""
        if isinstance(target, ast.Name):
            sequence = self.sequence(node)
            if sequence is not None:
                return [(target, *sequence)]
        if not isinstance(node, ast.Tuple | ast.List) and self._constant_tuple(node) is None:
            return None
        return self._columns(node, target, cast("tuple[Nested, ...]", self._constants(node)))

    def _columns(self, node: ast.expr, target: ast.expr, items: Sequence[Nested]) -> list[Column]:
        if not isinstance(target, ast.Tuple | ast.List):
            return [(target, *self._table(node, items))]
        names = target.elts
        if not items or any(isinstance(i, Constant) or len(i) != len(names) for i in items):
            raise self.problem(
                target,
                f"{len(names)} names for items that are not tuples of {len(names)} constants",
                "write as many values in each: for dx, dy in ((0, 1), (1, 0))",
            )
        rows = cast("Sequence[tuple[Nested, ...]]", items)
        parts = zip(names, zip(*rows, strict=True), strict=True)
        return [column for name, part in parts for column in self._columns(node, name, part)]

    def _constant_tuple(self, node: ast.expr) -> tuple[Any, ...] | None:
        """The tuple that a name of the module or class refers to."""
        reference = self.reference(node) if isinstance(node, ast.Name | ast.Attribute) else None
        constant: Any = reference.value if isinstance(reference, Known) else None
        return cast("tuple[Any, ...]", constant) if type(constant) is tuple else None

    def _constants(self, node: ast.expr) -> Nested:
        """A tuple that is written here, or a constant."""
        if isinstance(node, ast.Tuple | ast.List):
            return tuple(map(self._constants, node.elts))
        constant = self._constant_tuple(node)
        if constant is not None:
            return self._nested(node, constant)
        value = self.value(node)
        if not isinstance(value, Constant):
            raise self.problem(
                node,
                "a computed value in a tuple of a loop",
                "make a list and loop over it: values = [self.x, self.y]",
            )
        return value

    def _nested(self, node: ast.expr, values: tuple[Any, ...]) -> tuple[Nested, ...]:
        """A tuple of the module or class."""
        items: list[Nested] = []
        for value in values:
            inner = type(value) is tuple
            item = (
                self._nested(node, cast("tuple[Any, ...]", value))
                if inner
                else self.constant_of(value)
            )
            if item is None:
                raise self._no_table(node)
            items.append(item)
        return tuple(items)

    def _no_table(self, node: ast.expr) -> Exception:
        return self.problem(
            node, f"the tuple {ast.unparse(node)}", f"use 1 to {_TABLE:,} numbers, bools or texts"
        )

    def _table(self, node: ast.expr, items: Sequence[Nested]) -> tuple[str, ValueKind, int]:
        constants = [item for item in items if isinstance(item, Constant)]
        if len(constants) != len(items):
            raise self.problem(
                node,
                f"a tuple in the tuple {ast.unparse(node)} as a value",
                "name its values: for dx, dy in ((0, 1), (1, 0))",
            )
        if not 1 <= len(items) <= _TABLE:
            raise self._no_table(node)
        kind, converted = self.alike(node, constants)
        numbers = tuple(cast("Constant", item).value for item in converted)
        key = (kind, *map(repr, numbers))
        name, kind = self.method.tables.setdefault(
            (key, numbers), (f"TABLE_{len(self.method.tables)}", kind)
        )
        return name, kind, len(numbers)

    def members(self, node: ast.Compare) -> list[Expression]:
        """The values of a tuple, which is written here or a constant of the module or class."""
        given = node.comparators[0]
        if isinstance(given, ast.Tuple | ast.List | ast.Set) and given.elts:
            return [self.value(each) for each in given.elts]
        values = self._constant_tuple(given)
        if values:
            members = [self.constant_of(each) for each in values]
            if None not in members:
                return [each for each in members if each is not None]
        raise self.problem(
            node, "`in` of something else than a tuple", 'write the values: x in ("a", "b")'
        )

    # --- values ---

    def value(self, node: ast.expr) -> Expression:
        """The checked form of an expression. Raises NotCompilable."""
        check = self._checks.get(type(node))
        if check is None:
            raise self.problem(node, *EXPRESSIONS.get(type(node), ("this expression", "")))
        return check(node)

    # --- conditions ---

    def _logic(self, node: ast.BoolOp) -> Expression:
        values = [self.value(value) for value in node.values]
        if any(value.kind is not ValueKind.BOOL for value in values):
            raise self.problem(
                node,
                "`and` or `or` of values that are not bools, as a value",
                "compare them, or write `a if a else b`",
            )
        return Logic("and" if isinstance(node.op, ast.And) else "or", tuple(values))

    def _choice(self, node: ast.IfExp) -> Expression:
        test, yes, no = self.truth(node.test), self.value(node.body), self.value(node.orelse)
        kind, (yes, no) = self.alike(node, [yes, no])
        return Choice(kind, test, yes, no)

    def _comparison(self, node: ast.Compare) -> Expression:
        if len(node.ops) == 1 and isinstance(node.ops[0], ast.In | ast.NotIn):
            return self._membership(node)
        nodes = [node.left, *node.comparators]
        values = [self.value(each) for each in nodes]
        # A middle value is used twice, so it must not draw a number.
        if not all(isinstance(value, Constant | Variable | Item) for value in values[1:-1]):
            raise self.problem(
                node,
                "a chain of comparisons with a computed value in the middle",
                "assign that value to a variable first",
            )
        parts = [
            self.compared(node, operator, left, right)
            for operator, left, right in zip(node.ops, values, values[1:], strict=False)
        ]
        return parts[0] if len(parts) == 1 else Logic("and", tuple(parts))

    def compared(
        self, node: ast.AST, operator: ast.cmpop, left: Expression, right: Expression
    ) -> Expression:
        """The comparison of two values."""
        sign = _COMPARISONS.get(type(operator))
        if sign is None:
            raise self.problem(node, "`is`", "compare with ==, or use a bool attribute")
        texts = (left.kind is ValueKind.TEXT) + (right.kind is ValueKind.TEXT)
        if texts == 1:
            raise self.problem(node, "a text compared with a number", "compare equal types")
        if texts:
            if sign not in ("==", "!="):
                raise self.problem(node, "the order of texts", "compare texts with == or != only")
            return BinaryOperation(ValueKind.BOOL, sign, left, right)
        left, right = (
            Call(ValueKind.INT, "int", (each,)) if each.kind is ValueKind.BOOL else each
            for each in (left, right)
        )
        # Python compares an int with a real exactly, without rounding it.
        if left.kind is not right.kind:
            left, right = self.as_mixed(left), self.as_mixed(right)
        return BinaryOperation(ValueKind.BOOL, sign, left, right)

    def _membership(self, node: ast.Compare) -> Expression:
        value, members = self.value(node.left), self.members(node)
        if not isinstance(value, Constant | Variable | Item):
            raise self.problem(
                node, "`in` of a computed value", "assign that value to a variable first"
            )
        parts = [self.compared(node, ast.Eq(), value, each) for each in members]
        either = parts[0] if len(parts) == 1 else Logic("or", tuple(parts))
        return (
            UnaryOperation(ValueKind.BOOL, "not", either)
            if isinstance(node.ops[0], ast.NotIn)
            else either
        )

    # --- calls ---

    def _call(self, node: ast.Call) -> Expression:
        if isinstance(node.func, ast.Attribute):
            base = self.reference(node.func.value)
            if isinstance(base, Chance):
                return draw(self, node, node.func.attr)
            if isinstance(base, Moment):
                raise self.problem(
                    node, f"moment.{node.func.attr}(...) here", "write it as a statement of its own"
                )
        reference = self.reference(node.func)
        if isinstance(reference, BoundMethod):
            return self.helper(node, reference.function, (AgentItself(),))
        if isinstance(reference, Known):
            return self._call_known(node, reference.value)
        if isinstance(node.func, ast.Attribute):
            # A more precise error, if the value itself is the problem.
            owner = isinstance(self.reference(node.func.value), AgentItself)
            self.value(node.func if owner else node.func.value)
            raise self.problem(
                node, f"the method {node.func.attr} of a value", "use numbers and operators"
            )
        raise self.problem(node, "a call of this value", "call a function of the module")

    def _call_known(self, node: ast.Call, function: Any) -> Expression:
        if function is len:
            return self._length(node)
        known = FUNCTIONS.get(_key(function))
        if known is not None:
            if node.keywords:
                raise self.problem(node, "named arguments of this function", "write them in order")
            arguments = [self.value(argument) for argument in node.args]
            return known(self, node, arguments)
        if isinstance(function, FunctionType):
            return self.helper(node, function, ())
        if isinstance(function, EventType):
            raise self.problem(node, "an event as a value", "write moment.emit(...) around it")
        name = ast.unparse(node.func)
        raise self.problem(node, f"the function {name}", instead_of(name))

    def _length(self, node: ast.Call) -> Expression:
        if len(node.args) == 1 and not node.keywords:
            if isinstance(self.reference(node.args[0]), EventItself):
                return self.count_of_events(node)
            constant = self._constant_tuple(node.args[0])
            if constant is not None:
                return Constant(ValueKind.INT, len(constant))
            sequence = self.sequence(node.args[0])
            if sequence is not None:
                return Constant(ValueKind.INT, sequence[2])
        raise self.problem(node, "the length of this value", "use a constant tuple or a list")

    def count_of_events(self, node: ast.AST) -> Expression:
        """The number of events in a batch."""
        event = next(r for r in self.scope.references.values() if isinstance(r, EventItself))
        if not event.batch:
            raise self.problem(node, "the length of an event", "an event has data only")
        return BinaryOperation(
            ValueKind.INT, "-", Variable(ValueKind.INT, "e_end"), Variable(ValueKind.INT, "e_begin")
        )

    def helper(
        self, node: ast.Call, function: FunctionType, bound: tuple[Reference, ...]
    ) -> Expression:
        """A call of a function of the module, or of a method of the class."""
        raise NotImplementedError


def _key(function: Any) -> Any:
    """The object by which a known function is looked up; None if it cannot be a key."""
    try:
        hash(function)
    except TypeError:
        return None
    return function


def is_empty(value: Any) -> bool:
    """Whether an object of the module is the empty string ε."""
    return isinstance(value, Scene) and not value.pieces


def draw(check: Expressions, node: ast.Call, name: str) -> Expression:
    """A call of `moment.chance`."""
    distribution = DISTRIBUTIONS.get(name)
    if distribution is None:
        near = nearest(name, list(DISTRIBUTIONS))
        raise check.problem(node, f"moment.chance has no {name}{near}", CHOICES.get(name, ""))
    arguments = _arguments(check, node, distribution)
    check.method.draws = True
    if name == "exponential":
        # As in Python: the negative of an int 0 is 0, which a conversion before would change.
        arguments = [check.negative(node, arguments[0])]
    convert = partial(_bound, check) if name == "integers" else check.as_mixed
    given = [convert(argument) for argument in arguments]
    if name == "integers":
        return check.fault(distribution.kind, "draw_integers", WORDS, ROW, *given)
    return Call(distribution.kind, f"draw_{name}", (WORDS, ROW, *given))


def _bound(check: Expressions, value: Expression) -> Expression:
    return check.fault(ValueKind.INT, "bound", value)


def _arguments(check: Expressions, node: ast.Call, distribution: Distribution) -> list[Expression]:
    left = distribution.names[len(node.args) :]
    names = [str(keyword.arg) for keyword in node.keywords]
    if len(node.args) > len(distribution.names) or not {*names} <= {*left}:
        raise check.problem(node, f"these arguments; expected {', '.join(distribution.names)}")
    # Arguments may draw, and Python evaluates them in the order in which they are written.
    if names != sorted(names, key=left.index):
        raise check.problem(
            node, "named arguments in another order", f"write them as {', '.join(left)}"
        )
    given: dict[str, ast.expr] = dict(zip(distribution.names, node.args, strict=False))
    given |= {str(keyword.arg): keyword.value for keyword in node.keywords}
    values = {
        name: check.as_number(argument, check.value(argument)) for name, argument in given.items()
    }
    if distribution.kind is ValueKind.INT:
        if any(value.kind is not ValueKind.INT for value in values.values()):
            raise check.problem(node, "bounds that are not ints", "convert with int(...)")
        if "high" not in values and "low" in values:
            values = {"low": Constant(ValueKind.INT, 0), "high": values["low"]}
    for name, default in distribution.defaults.items():
        values.setdefault(name, Constant(ValueKind.REAL, default))
    missing = [name for name in distribution.names if name not in values]
    if missing:
        raise check.problem(node, f"the argument {missing[0]} is missing")
    return [values[name] for name in distribution.names]
