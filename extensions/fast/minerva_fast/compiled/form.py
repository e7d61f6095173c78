"""The checked form of a compiled method: typed expressions and statements.

`statements` makes it of a syntax tree, `code_generation` prints it as a Python module.
Whatever Python would answer with an error, or with a number that has no machine type, is a *fault*:
the row is undone, and the Python method itself runs for it. So the kernel needs no error messages.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any, TypeAlias


class ValueKind(Enum):
    """Kinds of values. MIXED: an int in one case and a real in another, held as a real."""

    INT = "an int"
    REAL = "a real number"
    MIXED = "an int in one case and a real in another"
    BOOL = "a bool"
    TEXT = "a text"

    @property
    def number(self) -> bool:
        """Whether it is an int or a real."""
        return self in (ValueKind.INT, ValueKind.REAL, ValueKind.MIXED)


DECLARED = {
    "int": ValueKind.INT,
    "real": ValueKind.REAL,
    "bool": ValueKind.BOOL,
    "text": ValueKind.TEXT,
}
"""Kinds by the declared kind of a type (grammar/types.py)."""


# --- expressions ---


@dataclass(frozen=True, slots=True)
class Constant:
    """A number or bool, or the code of a text."""

    kind: ValueKind
    value: float | int | bool


@dataclass(frozen=True, slots=True)
class Variable:
    """A variable of the generated function."""

    kind: ValueKind
    name: str


@dataclass(frozen=True, slots=True)
class Call:
    """A call of a function of the libraries, or of a helper."""

    kind: ValueKind
    function: str
    arguments: tuple[Expression, ...]


@dataclass(frozen=True, slots=True)
class BinaryOperation:
    """An operator between two values of one machine type."""

    kind: ValueKind
    operator: str
    left: Expression
    right: Expression


@dataclass(frozen=True, slots=True)
class UnaryOperation:
    """`-` of a real, or `not`."""

    kind: ValueKind
    operator: str
    operand: Expression


@dataclass(frozen=True, slots=True)
class Logic:
    """`and` or `or` of bools, evaluated from left to right as far as needed."""

    operator: str
    operands: tuple[Expression, ...]
    kind: ValueKind = ValueKind.BOOL


@dataclass(frozen=True, slots=True)
class Choice:
    """`yes if test else no`."""

    kind: ValueKind
    test: Expression
    yes: Expression
    no: Expression


@dataclass(frozen=True, slots=True)
class Item:
    """An item of a sequence of fixed length; an index out of range is a fault."""

    kind: ValueKind
    sequence: str
    length: int
    index: Expression


Expression: TypeAlias = (
    Constant | Variable | Call | BinaryOperation | UnaryOperation | Logic | Choice | Item
)


# --- statements ---


@dataclass(frozen=True, slots=True)
class Assign:
    """Assign to a variable."""

    name: str
    value: Expression


@dataclass(frozen=True, slots=True)
class SetItem:
    """Assign to an item of a list of fixed length."""

    sequence: str
    length: int
    index: Expression
    value: Expression


@dataclass(frozen=True, slots=True)
class If:
    """A branch."""

    test: Expression
    then: Sequence[Statement]
    otherwise: Sequence[Statement]


@dataclass(frozen=True, slots=True)
class While:
    """A loop with a condition; `otherwise` runs at its end, but not after a break."""

    test: Expression
    body: Sequence[Statement]
    otherwise: Sequence[Statement] = ()


@dataclass(frozen=True, slots=True)
class Count:
    """A loop over `range(start, stop, step)`; `otherwise` as for `While`."""

    counter: str
    start: Expression
    stop: Expression
    step: int
    body: Sequence[Statement]
    otherwise: Sequence[Statement] = ()


class Jump(Enum):
    """Statements without parts."""

    BREAK = "break"
    CONTINUE = "continue"
    PASS = "pass"  # noqa: S105  (a statement)
    FAULT = "fault"


@dataclass(frozen=True, slots=True)
class Append:
    """Append a row to an output: a newborn, or an emitted event."""

    output: int
    values: tuple[Expression, ...]


@dataclass(frozen=True, slots=True)
class Finish:
    """The end of the method: the agent stays or is gone; newborns not in `placed` are dropped."""

    stays: bool
    placed: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Return:
    """The result of a helper."""

    value: Expression


Statement: TypeAlias = Assign | SetItem | If | While | Count | Jump | Append | Finish | Return


# --- programs ---


@dataclass(frozen=True, slots=True)
class Limit:
    """What a number must fulfil where it is stored: finite, and in a range."""

    least: float = float("-inf")
    most: float = float("inf")


@dataclass(frozen=True, slots=True)
class Slot:
    """A named value with its kind: an attribute, a datum, a parameter or a cell of an output."""

    name: str
    kind: ValueKind


@dataclass(frozen=True, slots=True)
class Attribute:
    """An attribute of the agent: its kind, and what its values must fulfil at the end.

    `finite`: it is declared as a real number.
    """

    name: str
    kind: ValueKind
    finite: bool
    limit: Limit
    words: tuple[int, ...] = ()
    """Codes of the allowed texts; empty allows any."""


@dataclass(frozen=True, slots=True)
class Newborn:
    """An output with the newborns of one call of `child`: `births` and the attributes given."""

    symbol: Any
    """Agent class of the newborn."""
    slots: tuple[Slot, ...]


@dataclass(frozen=True, slots=True)
class Emission:
    """An output with the events of one type: data, and the codes of their receivers."""

    event_type: str
    names: tuple[str, ...]
    slots: tuple[Slot, ...]
    receivers: int
    condition: str


@dataclass(frozen=True, slots=True)
class Figure:
    """A primitive or transformation with the names of its given parameters, and its scope."""

    symbol: Any
    names: tuple[str, ...]
    scope: tuple[Figure, ...] = ()

    @property
    def width(self) -> int:
        """The number of parameters, with those of its scope."""
        return len(self.names) + sum(inner.width for inner in self.scope)


@dataclass(frozen=True, slots=True)
class Shown:
    """An output with the parameters of the figures that a view returns, numbered in their order.

    `shared`: numbers of those that are attributes, with their names; they are not in `slots`.
    """

    figures: tuple[Figure, ...]
    slots: tuple[Slot, ...]
    shared: tuple[tuple[str, str], ...] = ()


Output: TypeAlias = Newborn | Emission | Shown


@dataclass(frozen=True, slots=True)
class Helper:
    """A function or method that the compiled method calls; it reads attributes and draws."""

    name: str
    parameters: tuple[Slot, ...]
    kind: ValueKind
    body: Sequence[Statement]
    lists: tuple[ListSlot, ...] = ()


@dataclass(frozen=True, slots=True)
class ListSlot:
    """A list of fixed length in a local variable."""

    name: str
    kind: ValueKind
    length: int


@dataclass(frozen=True, slots=True)
class Program:
    """A checked method for one event type.

    `reads` and `writes` are attributes, `data` those of the event; `given` are further values that
    the kernel is passed: `dt`, `time`, `number`, `sender` and `id`.
    """

    title: str
    body: Sequence[Statement]
    reads: tuple[Attribute, ...]
    writes: tuple[Attribute, ...]
    data: tuple[Slot, ...]
    given: tuple[Slot, ...]
    draws: bool
    outputs: tuple[Output, ...]
    helpers: tuple[Helper, ...]
    lists: tuple[ListSlot, ...]
    tables: tuple[tuple[str, ValueKind, tuple[Any, ...]], ...]
    texts: tuple[str, ...]
