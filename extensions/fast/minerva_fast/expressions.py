"""Expressions of compiled functions: what names refer to, and Python's results or a fault.

Names and attributes, arithmetic for numbers of two kinds, items of arrays, comparisons, calls, and
draws.
"""

from __future__ import annotations

import ast
import inspect
from collections.abc import Callable, Sequence
from dataclasses import replace
from enum import IntEnum
from types import FunctionType, ModuleType
from typing import Any, Final, TypeAlias, cast, get_type_hints

import numpy as np

from minerva_bus.errors import nearest
from minerva_bus.grammar.scene import Scene
from minerva_bus.grammar.vocabulary import EventType
from minerva_bus.world.class_declaration import NotCompilable
from minerva_fast.draws import EXACT
from minerva_fast.functions import FUNCTIONS, FUNCTIONS_OF_RULES, Called, draw, instead_of
from minerva_fast.origin import EXPRESSIONS, MISSING, REAL_EVERYWHERE, TEXT_AS_NUMBER, Undefined
from minerva_fast.places import copy
from minerva_fast.values import (
    DECLARED,
    NUMBERS,
    BoundMethod,
    ColumnAccess,
    FunctionScope,
    Given,
    Items,
    Known,
    Method,
    Reference,
    RuleGrid,
    RuleTable,
    Value,
    ValueKind,
    constant,
    variable,
)

INT_BITS: Final = 2**63
"""Ints of machine code are below this."""
_OF_INTS: Final[dict[type[ast.operator], str]] = {
    ast.Add: "add",
    ast.Sub: "subtract",
    ast.Mult: "multiply",
    ast.FloorDiv: "floor_divide",
    ast.Mod: "modulo",
    ast.Pow: "power_of_ints",
}
"""Operators of two ints with results of 64 bits: a function of `library`."""
_SIGNS: Final[dict[type[ast.AST], str]] = {
    ast.Add: "+",
    ast.Sub: "-",
    ast.Mult: "*",
    ast.Div: "/",
    ast.FloorDiv: "//",
    ast.Mod: "%",
    ast.BitAnd: "&",
    ast.BitOr: "|",
    ast.BitXor: "^",
    ast.Eq: "==",
    ast.NotEq: "!=",
    ast.Lt: "<",
    ast.LtE: "<=",
    ast.Gt: ">",
    ast.GtE: ">=",
}
_MOST_SHIFT: Final = 62
_BITS: Final = (ast.BitAnd, ast.BitOr, ast.BitXor)
_OF_REALS: Final[dict[type[ast.operator], str]] = {
    ast.FloorDiv: "floor_divide_reals",
    ast.Mod: "modulo_reals",
    ast.Pow: "power",
}
_OF_MOMENT: Final = {"dt": ValueKind.REAL, "time": ValueKind.REAL, "number": ValueKind.INT}
_TABLE: Final = 10_000
_ITEMS: Final = (np.bool_, np.float64, np.int64)
"""Types of the items of constant arrays, which are those of Python's numbers."""
Column: TypeAlias = tuple[ast.expr, Items]
"""A name that takes the items of a sequence in turn."""
MakeHelper: TypeAlias = Callable[[ast.Call, FunctionType, tuple[Reference, ...]], Called]
"""Prints a call of user code."""


class Expressions:
    """Checks and prints the expressions of one function."""

    def __init__(self, method: Method, scope: FunctionScope, helper: MakeHelper) -> None:
        self.method = method
        self.scope = scope
        self._helper = helper
        self._checks: dict[type[ast.AST], Callable[[Any], Value]] = {
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

    def problem(self, node: ast.AST, what: str, instead: str = "") -> NotCompilable:
        """The error of a part of the function."""
        return self.scope.origin.problem(node, what, instead)

    def value(self, node: ast.expr) -> Value:
        """The value of an expression. Raises NotCompilable."""
        check = self._checks.get(type(node))
        if check is None:
            raise self.problem(node, *EXPRESSIONS.get(type(node), ("this expression", "")))
        return check(node)

    # --- names ---

    def text(self, text: str) -> Value:
        """A constant text as its code."""
        return constant(ValueKind.TEXT, self.method.code(text))

    def use(self, name: str, kind: ValueKind = ValueKind.INT) -> Value:
        """A variable of the row, which helpers are passed."""
        self.scope.reads[name] = made = variable(kind, name)
        return made

    def reference(self, node: ast.expr) -> Reference | None:
        """What a name refers to if it is not a value that is known only when the kernel runs."""
        if isinstance(node, ast.Name):
            return self._reference_of_name(node)
        if not isinstance(node, ast.Attribute):
            return None
        base = self.reference(node.value)
        match base:
            case Given.AGENT:
                return self._of_class(node)
            case Given.MOMENT if node.attr == "chance":
                return Given.CHANCE
            case RuleTable():
                return self._of_table(node, base)
            case Known() if isinstance(base.value, ModuleType | type):
                inner = self.method.attribute_of(base.value, node.attr)
                if inner is MISSING:
                    raise self.problem(node, f"{ast.unparse(node)} does not exist")
                return Known(inner)
            case _:
                return None

    def _reference_of_name(self, node: ast.Name) -> Reference | None:
        scope = self.scope
        if node.id in scope.references:
            if node.id in scope.aliases:
                self.certain(node)
            return scope.references[node.id]
        code = scope.origin.function.__code__
        if node.id in code.co_varnames or node.id in code.co_cellvars:
            return None
        value = self.method.known(scope.origin, node.id)
        if value is not MISSING:
            return Known(value)
        # The class itself has no name yet while it is made.
        if not self.method.rule and node.id == self.method.cls.__name__:
            return Known(self.method.cls)
        place = "rule" if self.method.rule else "class"
        what = f"{node.id} is not defined when the {place} is made"
        raise Undefined(str(self.problem(node, what, f"define {node.id} above the {place}")))

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

    def _of_table(self, node: ast.Attribute, table: RuleTable) -> Reference:
        parts: dict[str, Reference] = table.type.parts(table.name, own=table.own)
        if node.attr not in parts:
            shown, known = ast.unparse(node.value), [*parts]
            what = f"{shown} has no {node.attr}{nearest(node.attr, known)}"
            instead = f"declare it in the class of {shown}: {node.attr}: Column"
            raise self.problem(node, what, instead)
        return parts[node.attr]

    def _name(self, node: ast.Name) -> Value:
        match self.reference(node):
            case None:
                return self.variable(node)
            case Known(value):
                return self._frozen(node, value)
            case Given.OWN_ROW:
                return self.use("v_own")
            case Items():
                instead = f"use its items: {node.id}[0]"
                raise self.problem(node, f"the list {node.id} as a value", instead)
            case RuleTable(type=table):
                raise self.whole_table(node, table)
            case _:
                raise self.problem(node, f"{node.id} as a value", "use its attributes")

    def whole_table(self, node: ast.AST, table: Any, form: str = "NAME[i]") -> NotCompilable:
        """The error of a table in place of one of its columns."""
        shown, column = ast.unparse(node), table.names[-1]
        instead = f"write {shown}.{form.replace('NAME', column)}; a table is its columns"
        return self.problem(node, f"{shown} as a whole", instead)

    def variable(self, node: ast.Name) -> Value:
        """The value of a local variable, which must have one on every path."""
        name, scope = node.id, self.scope
        self.certain(node)
        made = variable(scope.kinds[name], f"v_{name}")
        return replace(made, newborn=name in scope.newborns)

    def certain(self, node: ast.Name) -> None:
        """Raise NotCompilable if a variable may have no value."""
        if self.scope.assigned is not None and node.id not in self.scope.assigned:
            instead = f"assign {node.id} before the branch or loop that sets it"
            raise self.problem(node, f"{node.id} may have no value here", instead)

    def _frozen(self, node: ast.expr, value: Any) -> Value:
        """A constant of the module or class."""
        made = self.constant_of(value)
        if made is not None and not (made.kind is ValueKind.TEXT and self.method.rule):
            return made
        if isinstance(value, int):
            instead = "write a real number, such as 1e20"
            raise self.problem(node, "an int of more than 64 bits", instead)
        name = f"a {type(value).__name__}"
        if isinstance(value, str | bytes):
            raise self.problem(node, "a text", "use numbers: a table has no texts")
        what = f"{ast.unparse(node)} is {name}, not a number, bool or text"
        instead = "use constants, attributes of self, data of the event, or local variables"
        if isinstance(value, Scene):
            instead = "return it: return self.string + self.child(...)"
        raise self.problem(node, what, instead)

    def constant_of(self, value: Any) -> Value | None:
        """A Python object as a constant; None if it is not a number, bool or text."""
        if isinstance(value, bool):
            return constant(ValueKind.BOOL, value)
        if (type(value) is int or isinstance(value, IntEnum)) and -INT_BITS <= value < INT_BITS:
            return constant(ValueKind.INT, int(value))
        if type(value) is float:
            return constant(ValueKind.REAL, value)
        return self.text(value) if type(value) is str else None

    def _constant(self, node: ast.Constant) -> Value:
        return self._frozen(node, node.value)

    # --- attributes ---

    def _attribute(self, node: ast.Attribute) -> Value:
        base = self.reference(node.value)
        match base:
            case Given.AGENT:
                return self._of_agent(node)
            case Given.EVENT:
                return self._of_event(node)
            case Given.MOMENT:
                return self._of_moment(node)
            case Given.CHANCE:
                what = f"{ast.unparse(node.value)}, a random stream, has no methods"
                raise self.problem(node, what, f"write {node.attr}({ast.unparse(node.value)}, ...)")
            case RuleGrid(text=text, type=shape):
                kind = NUMBERS.get(get_type_hints(shape).get(node.attr))
                if kind is not None:
                    self.use(text)
                    return Value(kind, f"{text}.{node.attr}", simple=True)
            case _:
                pass
        reference = self.reference(node)
        if isinstance(reference, Known):
            return self._frozen(node, reference.value)
        if isinstance(reference, Items):
            instead = f"use its items: {ast.unparse(node)}[i]"
            raise self.problem(node, f"{ast.unparse(node)} as a value", instead)
        what = f"the attribute {node.attr} of {ast.unparse(node.value)}"
        raise self.problem(node, what, "assign it to a constant at the top of the module")

    def _of_agent(self, node: ast.Attribute) -> Value:
        name = node.attr
        if name in self.method.types:
            return self.attribute(name)
        if name == "id":
            return self.given("id", ValueKind.TEXT)
        if name == "scope":
            raise self.problem(node, "self.scope", "agents with scopes evolve agent by agent")
        if name in ("string", "child"):
            instead = "return self.string + self.child(...) at the end"
            raise self.problem(node, f"self.{name} here", instead)
        reference = self._of_class(node)
        if isinstance(reference, Known):
            return self._frozen(node, reference.value)
        if isinstance(reference, BoundMethod):
            raise self.problem(node, f"the method {name} as a value", f"call it: self.{name}()")
        hint = nearest(name, list(self.method.types))
        what = f"{self.method.cls.__name__} has no attribute {name}{hint}"
        raise self.problem(node, what, f"declare {name} in the class, or use a local variable")

    def attribute(self, name: str) -> Value:
        """The value of an attribute of the agent."""
        return self.use(f"a_{name}", self.method.read(name))

    def given(self, name: str, kind: ValueKind) -> Value:
        """A value that the kernel is passed."""
        self.method.given[name] = kind
        return self.use(f"g_{name}", kind)

    def _of_moment(self, node: ast.Attribute) -> Value:
        kind = _OF_MOMENT.get(node.attr)
        if kind is not None:
            return self.given(node.attr, kind)
        instead = "use dt, time and number, and write in each draw: moment.chance.random()"
        raise self.problem(node, f"moment.{node.attr} as a value", instead)

    def _of_event(self, node: ast.Attribute) -> Value:
        name, declared = node.attr, self.method.event_type
        if name == "sender":
            self.method.given["sender"] = ValueKind.TEXT
            return Value(ValueKind.TEXT, "g_sender[k]", simple=True)
        if declared is None:
            instead = "define or import the event type in the module of this class"
            raise self.problem(node, "the types of this event's data are not known", instead)
        types = {datum.name: datum.type for datum in declared.fields.all}
        if name not in types:
            listed = ", ".join(types) or "no data"
            raise self.problem(node, f"{declared.name} has no {name}", f"it has {listed}")
        kind = DECLARED.get(types[name].kind)
        if kind is None:
            what = f"{declared.name}.{name} is a {types[name]}"
            raise self.problem(node, what, "send numbers, bools and texts")
        self.method.data[name] = kind
        return Value(kind, f"d_{name}[k]", simple=True)

    # --- arithmetic ---

    def truth(self, node: ast.expr) -> Value:
        """An expression as a condition."""
        if isinstance(node, ast.BoolOp):
            return self._joined(node, list(map(self.truth, node.values)))
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            return Value(ValueKind.BOOL, f"(not {self.truth(node.operand).text})")
        return self.as_truth(self.value(node))

    def as_truth(self, value: Value) -> Value:
        """Whether a value counts as true."""
        if value.kind is ValueKind.BOOL:
            return value
        empty = self.text("") if value.kind is ValueKind.TEXT else constant(value.kind, 0)
        return Value(ValueKind.BOOL, f"({value.text} != {empty.text})")

    def as_number(self, node: ast.AST, value: Value) -> Value:
        """A number; a bool counts as 0 or 1, as in Python."""
        if value.kind is ValueKind.BOOL:
            return Value(ValueKind.INT, f"int64({value.text})", simple=value.simple)
        if value.kind is ValueKind.TEXT:
            raise self.problem(node, "arithmetic with a text", "compare texts with == or != only")
        return value

    def as_real(self, value: Value) -> Value:
        """A number as Python converts it to a real."""
        if value.kind is not ValueKind.INT:
            return replace(value, kind=ValueKind.REAL)
        if value.constant is not None:
            return constant(ValueKind.REAL, float(value.constant))
        return Value(ValueKind.REAL, f"float64({value.text})", simple=value.simple)

    def as_exact(self, value: Value) -> Value:
        """A number as a real with the same digits; an int that would lose some is a fault."""
        if value.kind is not ValueKind.INT:
            return replace(value, kind=ValueKind.REAL)
        if value.constant is not None and abs(value.constant) <= EXACT:
            return constant(ValueKind.REAL, float(value.constant))
        return Value(ValueKind.REAL, f"exact({value.text})")

    def alike(self, node: ast.AST, values: Sequence[Value]) -> tuple[ValueKind, list[Value]]:
        """Values that are used in one place, and their kind."""
        kinds = {value.kind for value in values}
        if len(kinds) == 1:
            return values[0].kind, [*values]
        if kinds <= {ValueKind.INT, ValueKind.REAL, ValueKind.NUMBER}:
            return ValueKind.NUMBER, [self.as_exact(value) for value in values]
        what = f"{' and '.join(sorted([kind.value for kind in kinds]))} in one place"
        raise self.problem(node, what, "use one type")

    def definite(self, node: ast.AST, value: Value) -> Value:
        """A value that is not an int in one case and a real in another."""
        if value.kind is ValueKind.NUMBER:
            raise self.problem(node, value.kind.value, REAL_EVERYWHERE)
        return value

    def one_kind(self, *kinds: ValueKind) -> str:
        """What to write in place of values of different kinds."""
        return REAL_EVERYWHERE if {*kinds} == {ValueKind.INT, ValueKind.REAL} else "use one type"

    def _operation(self, node: ast.BinOp) -> Value:
        return self.of_values(node, node.op, self.value(node.left), self.value(node.right))

    def of_values(self, node: ast.AST, operator: ast.operator, left: Value, right: Value) -> Value:
        """The result of an operator between two values."""
        if left.kind is right.kind is ValueKind.BOOL and isinstance(operator, _BITS):
            # A bool in Python, and an int here.
            raise self.problem(node, "an operator on bits of bools", "write and, or, or !=")
        left, right = self.as_number(node, left), self.as_number(node, right)
        kinds = {left.kind, right.kind}
        if isinstance(operator, ast.Div):
            return self._quotient(left, right)
        if kinds == {ValueKind.INT}:
            return self._of_ints(node, operator, left, right)
        if ValueKind.REAL not in kinds:
            raise self.problem(node, ValueKind.NUMBER.value, REAL_EVERYWHERE)
        left, right = self.as_real(left), self.as_real(right)
        function = _OF_REALS.get(type(operator))
        if function is not None:
            return Value(ValueKind.REAL, f"{function}({left.text}, {right.text})")
        if not isinstance(operator, ast.Add | ast.Sub | ast.Mult):
            raise self.problem(node, "an operator on bits of a real", "convert with int(...)")
        return Value(ValueKind.REAL, f"({left.text} {_SIGNS[type(operator)]} {right.text})")

    def _quotient(self, left: Value, right: Value) -> Value:
        # Python rounds an int to a real first, but the quotient of two ints is rounded once.
        convert = self.as_real if ValueKind.REAL in (left.kind, right.kind) else self.as_exact
        return Value(ValueKind.REAL, f"({convert(left).text} / {convert(right).text})")

    def _of_ints(self, node: ast.AST, operator: ast.operator, left: Value, right: Value) -> Value:
        known = right.constant is not None and right.constant > 0
        if isinstance(operator, ast.Pow) and not known and right.constant != 0:
            what = "a power of ints whose exponent is not a constant from 0 up"
            raise self.problem(node, what, "make the base a real number: float(n) ** k")
        if isinstance(operator, ast.LShift | ast.RShift):
            bits = int(right.constant or 0)
            if not 0 < bits <= _MOST_SHIFT:
                what = f"a shift by anything but a constant from 1 to {_MOST_SHIFT}"
                raise self.problem(node, what, "write n * 2 ** k or n // 2 ** k")
            right = constant(ValueKind.INT, 2**bits)
            operator = ast.Mult() if isinstance(operator, ast.LShift) else ast.FloorDiv()
        sign = _SIGNS.get(type(operator))
        if isinstance(operator, _BITS) or (known and isinstance(operator, ast.FloorDiv | ast.Mod)):
            return Value(ValueKind.INT, f"({left.text} {sign} {right.text})")
        if type(operator) not in _OF_INTS:
            raise self.problem(node, "this operator", "write the products")
        return Value(ValueKind.INT, f"{_OF_INTS[type(operator)]}({left.text}, {right.text})")

    def _unary(self, node: ast.UnaryOp) -> Value:
        if isinstance(node.op, ast.Not):
            return self.truth(node)
        operand = self.as_number(node.operand, self.value(node.operand))
        if isinstance(node.op, ast.UAdd):
            return operand
        if isinstance(node.op, ast.Invert):
            if operand.kind is not ValueKind.INT:
                raise self.problem(node, "~ of a real", "convert with int(...)")
            return Value(ValueKind.INT, f"({operand.text} ^ -1)")
        return self.negative(self.definite(node, operand))

    def negative(self, operand: Value) -> Value:
        """The negative of a number."""
        if operand.constant is not None and operand.constant > -INT_BITS:
            return constant(operand.kind, -operand.constant)
        if operand.kind is ValueKind.INT:
            return Value(ValueKind.INT, f"subtract(0, {operand.text})")
        return Value(ValueKind.REAL, f"(-{operand.text})")

    # --- items ---

    def _item(self, node: ast.Subscript) -> Value:
        items, place = self.place_of(node)
        self.access(node, items, place)
        return self.item_at(items, place.text)

    def item_at(self, items: Items, place: str) -> Value:
        """An item at a place that exists."""
        text = f"{items.text}[{place}]"
        return Value(items.kind, f"int64({text})" if items.item == "int16" else text, simple=True)

    def place_of(self, node: ast.Subscript) -> tuple[Items, Value]:
        """An array, and the place of an item that an index refers to."""
        items = self.items(node.value)
        if items is None:
            base = self.reference(node.value)
            if base is Given.CHANCE:
                instead = "draw numbers: random(draws), integers(draws, 6)"
                raise self.problem(node, "an item of a random stream", instead)
            if isinstance(base, RuleTable):
                raise self.whole_table(node.value, base.type)
            what = "an item of this value"
            raise self.problem(node, what, "index a constant tuple or a local list of numbers")
        return items, self.place(node, items)

    def place(self, node: ast.Subscript, items: Items) -> Value:
        """An index, counted from the start."""
        if isinstance(node.slice, ast.Slice | ast.Tuple):
            shown = ast.unparse(node.value)
            if items.owner:
                instead = f"write {shown}[y * width + x] for a cell"
                raise self.problem(node, "an index that is not one number", instead)
            raise self.problem(node, "a slice", "write a for loop over the index")
        index = self.value(node.slice)
        if index.kind is not ValueKind.INT:
            raise self.problem(node.slice, f"{index.kind.value} as an index", "use an int")
        self._use(items)
        if index.text == "v_own" and items.own:
            return index
        known, size = index.constant, items.size
        if known is not None and -size <= known < size:
            return constant(ValueKind.INT, known % size)
        function = "place" if size else "existing"
        text = f"{function}({index.text}, {items.length})"
        return Value(ValueKind.INT, text, newborn=index.newborn)

    def _use(self, items: Items) -> None:
        """Pass an array to the helper that uses it."""
        if not items.text.startswith("TABLE_"):
            self.use(items.text)
        if items.column:
            self.use(items.length.partition("[")[0])

    def access(self, node: ast.AST, items: Items, place: Value, *, writes: bool = False) -> None:
        """Note the use of an item of a table or matrix, unless only this activation knows it."""
        if items.owner and not place.newborn:
            self.note(node, items.owner, items.column, own=place.text == "v_own", writes=writes)

    def note(
        self, node: ast.AST, owner: str, column: str, *, own: bool, writes: bool = False
    ) -> None:
        """Note the use of a column or matrix."""
        looped = self.scope.loops > 0
        made = ColumnAccess(self.scope.origin, node, owner, column, own, writes, looped)
        self.scope.accesses.append(made)

    def items(self, node: ast.expr) -> Items | None:
        """The array that an expression refers to, or the constant tuple."""
        reference = self.reference(node) if isinstance(node, ast.Name | ast.Attribute) else None
        if isinstance(reference, Items):
            return reference
        known = self._constant_tuple(node)
        return None if known is None else self._table(node, known)

    def columns(self, node: ast.expr, target: ast.expr) -> list[Column] | None:
        """The names of a loop with the sequences that they go over; None if there are none."""
        if isinstance(target, ast.Name):
            items = self.items(node)
            if items is not None and items.size:
                return [(target, items)]
        if not isinstance(node, ast.Tuple | ast.List) and self._constant_tuple(node) is None:
            return None
        return self._columns(node, target, self._constants(node))

    def _columns(self, node: ast.expr, target: ast.expr, items: Sequence[Any]) -> list[Column]:
        if not isinstance(target, ast.Tuple | ast.List):
            return [(target, self._table(node, items))]
        names = target.elts
        if not items or any(type(i) is not tuple or len(i) != len(names) for i in items):
            what = f"{len(names)} names for items that are not tuples of {len(names)} constants"
            instead = "write as many values in each: for dx, dy in ((0, 1), (1, 0))"
            raise self.problem(target, what, instead)
        parts = zip(names, zip(*items, strict=True), strict=True)
        return [column for name, part in parts for column in self._columns(node, name, part)]

    def _constant_tuple(self, node: ast.expr) -> tuple[Any, ...] | None:
        """The tuple, or array with one dimension, that a name of the module or class refers to."""
        reference = self.reference(node) if isinstance(node, ast.Name | ast.Attribute) else None
        known: Any = reference.value if isinstance(reference, Known) else None
        if isinstance(known, np.ndarray):
            array = cast("np.ndarray[Any, Any]", known)
            if array.dtype not in _ITEMS or array.ndim != 1:
                instead = "convert it to one dimension of float64 or int64, as Python's numbers are"
                raise self.problem(node, f"a constant of {array.dtype}", instead)
            return tuple(array.tolist())
        return cast("tuple[Any, ...]", known) if type(known) is tuple else None

    def _constants(self, node: ast.expr) -> Any:
        """A tuple that is written here or a constant of the module or class, or a value."""
        if isinstance(node, ast.Tuple | ast.List):
            return tuple(map(self._constants, node.elts))
        known = self._constant_tuple(node)
        if known is not None:
            return known
        value = self.value(node)
        if value.constant is None:
            instead = "make a list and loop over it: values = [self.x, self.y]"
            raise self.problem(node, "a computed value in a tuple of a loop", instead)
        return value

    def _table(self, node: ast.expr, items: Sequence[Any]) -> Items:
        shown = ast.unparse(node)
        if any(type(item) is tuple for item in items):
            what = f"a tuple in the tuple {shown} as a value"
            raise self.problem(node, what, "name its values: for dx, dy in ((0, 1), (1, 0))")
        made = [item if isinstance(item, Value) else self.constant_of(item) for item in items]
        known = [each for each in made if each is not None]
        if len(known) != len(made) or not 1 <= len(made) <= _TABLE:
            instead = f"use 1 to {_TABLE:,} numbers, bools or texts"
            raise self.problem(node, f"the tuple {shown}", instead)
        kind, values = self.alike(node, known)
        self.definite(node, Value(kind, ""))
        key = (kind, *[value.text for value in values])
        name, size = f"TABLE_{len(self.method.tables)}", len(values)
        return self.method.tables.setdefault(key, Items(name, kind, str(size), size))

    def members(self, node: ast.Compare) -> list[Value]:
        """The values of a tuple, which is written here or a constant of the module or class."""
        given = node.comparators[0]
        if isinstance(given, ast.Tuple | ast.List | ast.Set) and given.elts:
            return [self.value(each) for each in given.elts]
        members = [self.constant_of(each) for each in self._constant_tuple(given) or (None,)]
        made = [each for each in members if each is not None]
        if len(made) != len(members):
            instead = 'write the values: x in ("a", "b")'
            raise self.problem(node, "`in` of something else than a tuple", instead)
        return made

    # --- conditions ---

    def _joined(self, node: ast.BoolOp, values: Sequence[Value]) -> Value:
        word = " and " if isinstance(node.op, ast.And) else " or "
        return Value(ValueKind.BOOL, f"({word.join([value.text for value in values])})")

    def _logic(self, node: ast.BoolOp) -> Value:
        values = [self.value(value) for value in node.values]
        if any(value.kind is not ValueKind.BOOL for value in values):
            what = "`and` or `or` of values that are not bools, as a value"
            raise self.problem(node, what, "compare them, or write `a if a else b`")
        return self._joined(node, values)

    def _choice(self, node: ast.IfExp) -> Value:
        test, values = self.truth(node.test), [self.value(node.body), self.value(node.orelse)]
        kind, (yes, no) = self.alike(node, values)
        return Value(kind, f"({yes.text} if {test.text} else {no.text})")

    def _comparison(self, node: ast.Compare) -> Value:
        if len(node.ops) == 1 and isinstance(node.ops[0], ast.In | ast.NotIn):
            return self._membership(node)
        values = [self.value(each) for each in (node.left, *node.comparators)]
        # A middle value is used twice, so it must not draw a number.
        if not all(value.simple for value in values[1:-1]):
            what = "a chain of comparisons with a computed value in the middle"
            raise self.problem(node, what, "assign that value to a variable first")
        pairs = zip(node.ops, values, values[1:], strict=False)
        parts = [self.compared(node, *each).text for each in pairs]
        return Value(ValueKind.BOOL, parts[0] if len(parts) == 1 else f"({' and '.join(parts)})")

    def compared(self, node: ast.AST, operator: ast.cmpop, left: Value, right: Value) -> Value:
        """The comparison of two values."""
        sign = _SIGNS.get(type(operator))
        if sign is None:
            raise self.problem(node, "`is`", "compare with ==, or use a bool attribute")
        texts = (left.kind is ValueKind.TEXT) + (right.kind is ValueKind.TEXT)
        if texts == 1:
            raise self.problem(node, "a text compared with a number", "compare equal types")
        if texts and sign not in ("==", "!="):
            raise self.problem(node, "the order of texts", "compare texts with == or != only")
        if not texts:
            left, right = self.as_number(node, left), self.as_number(node, right)
            # Python compares an int with a real exactly, without rounding it.
            if left.kind is not right.kind:
                left, right = self.as_exact(left), self.as_exact(right)
        return Value(ValueKind.BOOL, f"({left.text} {sign} {right.text})")

    def _membership(self, node: ast.Compare) -> Value:
        value, members = self.value(node.left), self.members(node)
        if not value.simple:
            instead = "assign that value to a variable first"
            raise self.problem(node, "`in` of a computed value", instead)
        parts = [self.compared(node, ast.Eq(), value, each).text for each in members]
        negated = "not " if isinstance(node.ops[0], ast.NotIn) else ""
        return Value(ValueKind.BOOL, f"({negated}({' or '.join(parts)}))")

    # --- calls ---

    def _call(self, node: ast.Call) -> Value:
        kind, text = self.call(node)
        if kind is None:
            what = f"{ast.unparse(node.func)} as a value, which it does not return"
            raise self.problem(node, what, "end the function with return")
        known = self.reference(node.func)
        return Value(kind, text, newborn=isinstance(known, Known) and known.value is copy)

    def call(self, node: ast.Call) -> Called:
        """A call: the kind of its result, and its text."""
        if isinstance(node.func, ast.Attribute):
            base = self.reference(node.func.value)
            if base is Given.CHANCE and not self.method.rule:
                return draw(self, node, node.func.attr, node.args)
            if base is Given.MOMENT:
                what = f"moment.{node.func.attr}(...) here"
                raise self.problem(node, what, "write it as a statement of its own")
        reference = self.reference(node.func)
        if isinstance(reference, BoundMethod):
            return self._helper(node, reference.function, (Given.AGENT,))
        if isinstance(reference, Known):
            return self._call_known(node, reference.value)
        if isinstance(node.func, ast.Attribute):
            # A more precise error, if the value itself is the problem.
            owner = self.reference(node.func.value) in (Given.AGENT, Given.CHANCE)
            self.value(node.func if owner else node.func.value)
            what = f"the method {node.func.attr} of a value"
            raise self.problem(node, what, instead_of(node.func.attr, self.method.rule))
        raise self.problem(node, "a call of this value", "call a function of the module")

    def _call_known(self, node: ast.Call, function: Any) -> Called:
        key = function if isinstance(function, FunctionType) or callable(function) else None
        try:
            known = FUNCTIONS.get(key)
            of_rules = FUNCTIONS_OF_RULES.get(key) if self.method.rule else None
        except TypeError:  # it cannot be a key
            known = of_rules = None
        if of_rules is not None:
            return of_rules(self, node)
        if function is len:
            return ValueKind.INT, self._length(node)
        if known is not None:
            if node.keywords:
                raise self.problem(node, "named arguments of this function", "write them in order")
            texts = [each for each in node.args if isinstance(each, ast.Constant)]
            if function is float and any(isinstance(each.value, str) for each in texts):
                raise self.problem(node, *TEXT_AS_NUMBER)
            made = known(self, node, [self.value(argument) for argument in node.args])
            return made.kind, made.text
        if isinstance(function, FunctionType) and function.__module__.split(".")[0] != "numpy":
            return self._helper(node, function, ())
        if isinstance(function, EventType):
            raise self.problem(node, "an event as a value", "write moment.emit(...) around it")
        name = ast.unparse(node.func)
        what = f"the function {name}"
        raise self.problem(node, what, instead_of(name, self.method.rule, function))

    def _length(self, node: ast.Call) -> str:
        if len(node.args) == 1 and not node.keywords:
            reference = self.reference(node.args[0])
            if isinstance(reference, RuleTable):
                raise self.whole_table(node.args[0], reference.type, "NAME")
            known = self._constant_tuple(node.args[0])
            if known is not None:
                return constant(ValueKind.INT, len(known)).text
            items = self.items(node.args[0])
            if items is not None:
                self._use(items)
                return items.length
        raise self.problem(node, "the length of this value", "use a constant tuple or a list")


def is_empty(value: Any) -> bool:
    """Whether an object of the module is the empty string ε."""
    return isinstance(value, Scene) and not value.pieces
