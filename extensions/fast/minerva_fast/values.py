"""What the checker knows of a function: kinds of values, what names stand for, and what it makes.

The checker prints while it checks: a value is the text of an expression with its kind, a statement
is lines. Where Python would answer with an error, or with a number that has no machine type, the
text raises an error, a *fault*, and the function itself runs as Python for this row.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from types import FunctionType
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_bus.grammar.types import Type
from minerva_bus.grammar.vocabulary import EventType
from minerva_fast.origin import MISSING, Origin, lookup


class ValueKind(Enum):
    """Kinds of values. NUMBER: an int in one case and a real in another, held as a real.

    Such a number is no variable: it is converted to a real where it is used.
    """

    INT = "an int"
    REAL = "a real number"
    NUMBER = "an int in one case and a real in another"
    BOOL = "a bool"
    TEXT = "a text"

    @property
    def machine(self) -> str:
        """The type of numba that holds it."""
        return {ValueKind.BOOL: "boolean", ValueKind.REAL: "float64"}.get(self, "int64")


NUMBERS: Final[Mapping[Any, ValueKind]] = {
    int: ValueKind.INT,
    float: ValueKind.REAL,
    bool: ValueKind.BOOL,
}
DTYPES: Final[Mapping[ValueKind, Any]] = {
    ValueKind.INT: np.int64,
    ValueKind.REAL: np.float64,
    ValueKind.BOOL: np.bool_,
    ValueKind.TEXT: np.int64,
}
"""Types of arrays; a text is its code."""
DECLARED: Final[Mapping[str, ValueKind]] = {
    "int": ValueKind.INT,
    "real": ValueKind.REAL,
    "bool": ValueKind.BOOL,
    "text": ValueKind.TEXT,
}
"""Kinds by the declared kind of a type (grammar/types.py); a column cannot hold others."""


@dataclass(frozen=True, slots=True)
class Value:
    """An expression of the generated function.

    `constant` is its value if that is known; a text has its code. `simple`: it may be computed
    twice, as a variable or an item may. `newborn`: it is the row of a copy.
    """

    kind: ValueKind
    text: str
    constant: Any = None
    simple: bool = False
    newborn: bool = False

    @property
    def variable(self) -> str:
        """The name of the variable that it is; empty if it is something else."""
        return self.text if self.text.isidentifier() else ""


def variable(kind: ValueKind, name: str) -> Value:
    """A variable of the generated function."""
    return Value(kind, name, simple=True)


def constant(kind: ValueKind, number: Any) -> Value:
    """A constant; reals keep every bit, and infinity and nan have names of `library`."""
    if kind is ValueKind.BOOL:
        text = "True" if number else "False"
    elif kind in (ValueKind.INT, ValueKind.TEXT):
        # The literal of the least int would be the negative of a number beyond 64 bits.
        text = f"({int(number)})" if int(number) != -(2**63) else "LEAST_INT"
    elif number != number:
        text = "NAN"
    elif number in (float("inf"), float("-inf")):
        text = "INFINITY" if number > 0 else "(-INFINITY)"
    else:
        text = f"({float(number)!r})"
    return Value(kind, text, number, simple=True)


# --- what a row makes ---


@dataclass(frozen=True, slots=True)
class Slot:
    """A named value with its kind: a parameter or a cell of an output."""

    name: str
    kind: ValueKind


@dataclass(frozen=True, slots=True)
class Newborn:
    """An output with the newborns of one call of `child`: `births` and the attributes given."""

    symbol: Any
    """Agent class of the newborn; None: that of its parent."""
    slots: tuple[Slot, ...]


@dataclass(frozen=True, slots=True)
class Emission:
    """An output with the events of one type: data, and the code of a receiver, if they have one."""

    event_type: str
    slots: tuple[Slot, ...]
    receiver: bool
    condition: str


Output: TypeAlias = Newborn | Emission


STEP: Final = "    "


def indented(lines: Sequence[str]) -> list[str]:
    """Lines one step further to the right; `pass` for none."""
    return [STEP + line for line in lines or ["pass"]]


# --- what names refer to ---


class Given(Enum):
    """What a parameter stands for, beside numbers, tables and matrices."""

    AGENT = "self"
    EVENT = "the event"
    MOMENT = "moment"
    CHANCE = "moment.chance, or the parameter draws of a rule"
    OWN_ROW = "the row or cell of a rule, which its subject has"


@dataclass(frozen=True, slots=True)
class Known:
    """An object of the module, such as a constant, a function or an event type."""

    value: Any


@dataclass(frozen=True, slots=True)
class BoundMethod:
    """A method of the agent, as in `self.grow(2)`."""

    function: Any


@dataclass(frozen=True, slots=True)
class RuleGrid:
    """The shape of a lattice, a field or a graph: an argument of functions for rules."""

    text: str
    type: Any


@dataclass(frozen=True, slots=True)
class RuleTable:
    """A table of a rule, or its state before the rule; `own`: of its subject."""

    name: str
    type: Any
    own: bool


@dataclass(frozen=True, slots=True)
class Items:
    """An array: a list, a constant tuple, a column of a table or a matrix.

    Attributes:
        text: its variable.
        kind: of its items.
        length: the text of its length.
        size: its length if that is constant, and else 0; negative indices count from the end then.
        owner: the parameter of a rule of which it is a part.
        column: the name of a column; empty for a matrix.
        item: the type of items that are shorter than ints of 64 bits, or "real" for an array that
            holds ints as reals.
        fixed: why a rule cannot assign to its items.
        own: whether the row or cell of a rule is one of its indices.

    """

    text: str
    kind: ValueKind
    length: str
    size: int = 0
    owner: str = ""
    column: str = ""
    item: str = ""
    fixed: str = ""
    own: bool = False


Reference = Known | Given | BoundMethod | RuleGrid | RuleTable | Items


@dataclass(frozen=True, slots=True)
class ColumnAccess:
    """What an activation of a rule does with a column of a table, or with a matrix ("")."""

    origin: Origin
    node: Any
    owner: str
    column: str
    own: bool
    """Whether it concerns the row of the rule."""
    writes: bool = False
    looped: bool = False


@dataclass(frozen=True, slots=True)
class Helper:
    """A function or method that the checked function calls; it reads attributes and draws.

    `kind` is that of its result; None if it has none.
    """

    name: str
    parameters: tuple[Slot, ...]
    kind: ValueKind | None
    lines: Sequence[str]
    accesses: Sequence[ColumnAccess]


@dataclass(slots=True)
class Method:
    """What is collected of a method or rule, and of the helpers that it calls.

    `reads` and `writes` are attributes of the agent, `data` those of the event; `given` are further
    values that the kernel is passed: `dt`, `time`, `number`, `sender` and `id`.
    """

    title: str
    cls: Any = None
    types: Mapping[str, Type] = field(default_factory=dict[str, Type])
    event_type: EventType | None = None
    text: str = ""
    """The generated module."""
    texts: dict[str, int] = field(default_factory=dict[str, int])
    reads: dict[str, ValueKind] = field(default_factory=dict[str, ValueKind])
    writes: dict[str, None] = field(default_factory=dict[str, None])
    data: dict[str, ValueKind] = field(default_factory=dict[str, ValueKind])
    given: dict[str, ValueKind] = field(default_factory=dict[str, ValueKind])
    outputs: list[Output] = field(default_factory=list[Output])
    helpers: dict[Any, Helper] = field(default_factory=dict[Any, Helper])
    lists: dict[Any, Items] = field(default_factory=dict[Any, Items])
    tables: dict[tuple[Any, ...], Items] = field(default_factory=dict[tuple[Any, ...], Items])
    constants: dict[tuple[Any, str], Any] = field(default_factory=dict[tuple[Any, str], Any])
    """Objects that names referred to; a later change of one makes the compiled code outdated."""
    calling: list[FunctionType] = field(default_factory=list[FunctionType])
    called: dict[Any, None] = field(default_factory=dict[Any, None])
    """Functions for rules that are called."""
    draws: bool = False

    @property
    def rule(self) -> bool:
        """Whether it is a rule of a space, which has no agent."""
        return self.cls is None

    def read(self, name: str) -> ValueKind:
        """The kind of an attribute of the agent, which the kernel is passed."""
        return self.reads.setdefault(name, DECLARED[self.types[name].kind])

    def new_lists(self) -> list[NDArray[Any]]:
        """New arrays for local lists."""
        return [np.empty(each.size, DTYPES[each.kind]) for each in self.lists.values()]

    def code(self, text: str) -> int:
        """The code of a constant text."""
        return self.texts.setdefault(text, len(self.texts))

    def known(self, origin: Origin, name: str) -> Any:
        """The object of a name outside a function, recorded; MISSING if there is none."""
        value = lookup(origin.function, name)
        self.constants[origin.function, name] = value
        return value

    def attribute_of(self, owner: Any, name: str) -> Any:
        """The attribute of a module or class, recorded; MISSING if there is none."""
        value: Any = getattr(owner, name, MISSING)
        self.constants[owner, name] = value
        return value

    def current(self) -> bool:
        """Whether all names still refer to the same objects."""
        return all(
            (lookup(owner, name) if isinstance(owner, FunctionType) else getattr(owner, name, None))
            is value
            for (owner, name), value in self.constants.items()
        )


@dataclass(slots=True)
class FunctionScope:
    """The names within one function: of the method or rule, or of a helper.

    `assigned` are variables that certainly have a value; None where the code is not reached.
    """

    origin: Origin
    references: dict[str, Reference]
    kinds: dict[str, ValueKind] = field(default_factory=dict[str, ValueKind])
    lines: dict[str, int] = field(default_factory=dict[str, int])
    """The lines that gave variables their kinds."""
    assigned: set[str] | None = field(default_factory=set[str])
    reads: dict[str, Value] = field(default_factory=dict[str, Value])
    """Variables of the row that a helper is passed, by name."""
    result: ValueKind | None = None
    newborns: set[str] = field(default_factory=set[str])
    """Variables that are rows of copies."""
    accesses: list[ColumnAccess] = field(default_factory=list[ColumnAccess])
    aliases: set[str] = field(default_factory=set[str])
    """Variables that are other names of arrays and tables."""
    loops: int = 0
    names: Iterator[int] = field(default_factory=lambda: iter(range(1_000_000)))

    def temporary(self) -> str:
        """The name of a new variable of the generated function."""
        return f"t_{next(self.names)}"


def both(first: set[str] | None, second: set[str] | None) -> set[str] | None:
    """Variables that have a value on both paths; None is a path that is not taken."""
    if first is None or second is None:
        return second if first is None else first
    return first & second
