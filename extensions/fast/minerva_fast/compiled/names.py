"""What the names of a method refer to: its parameters, variables, and objects of its module."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from types import FunctionType
from typing import Any, Final

from minerva_bus.grammar.types import Type
from minerva_bus.grammar.vocabulary import EventType
from minerva_bus.user_code import variables_of
from minerva_fast.compiled.form import (
    DECLARED,
    Emission,
    Helper,
    Limit,
    ListSlot,
    Newborn,
    Output,
    Shown,
    Slot,
    ValueKind,
    Variable,
)
from minerva_fast.compiled.origin import MISSING, Origin, lookup

STATE: Final = Variable(ValueKind.REAL, "state")
"""An array of the kernel: a fault of the row, a 0 that no optimizer knows, turns of loops."""
WORDS: Final = Variable(ValueKind.INT, "words")
ROW: Final = Variable(ValueKind.INT, "i")
PLACE: Final = Variable(ValueKind.INT, "k")


@dataclass(frozen=True, slots=True)
class Known:
    """An object of the module, such as a constant, a function or an event type."""

    value: Any


@dataclass(frozen=True, slots=True)
class AgentItself:
    """The parameter `self`."""


@dataclass(frozen=True, slots=True)
class BoundMethod:
    """A method of the agent, as in `self.grow(2)`."""

    function: Any


@dataclass(frozen=True, slots=True)
class EventItself:
    """The parameter with the event; `batch`: with all events of the agent in a frame."""

    batch: bool = False
    place: Variable = PLACE
    """The row of the event in the data."""


@dataclass(frozen=True, slots=True)
class Moment:
    """The parameter `moment`."""


@dataclass(frozen=True, slots=True)
class Chance:
    """`moment.chance`."""


Reference = Known | AgentItself | BoundMethod | EventItself | Moment | Chance


@dataclass(slots=True)
class Method:
    """What is collected of a method, and of the helpers that it calls, while it is checked.

    `kinds` are those of the agent's attributes: a real attribute that a method of the class sets to
    an int is MIXED, and the check is repeated with that.
    """

    cls: Any
    types: Mapping[str, Type]
    kinds: dict[str, ValueKind]
    event_type: EventType | None
    texts: dict[str, int] = field(default_factory=dict[str, int])
    reads: dict[str, None] = field(default_factory=dict[str, None])
    writes: dict[str, None] = field(default_factory=dict[str, None])
    data: dict[str, ValueKind] = field(default_factory=dict[str, ValueKind])
    given: dict[str, ValueKind] = field(default_factory=dict[str, ValueKind])
    outputs: list[Output] = field(default_factory=list[Output])
    helpers: dict[Any, Helper] = field(default_factory=dict[Any, Helper])
    tables: dict[tuple[Any, ...], tuple[str, ValueKind]] = field(
        default_factory=dict[tuple[Any, ...], tuple[str, ValueKind]]
    )
    constants: dict[tuple[Any, str], Any] = field(default_factory=dict[tuple[Any, str], Any])
    """Objects that names referred to; a later change of one makes the compiled code outdated."""
    calling: list[FunctionType] = field(default_factory=list[FunctionType])
    int_lines: dict[str, int] = field(default_factory=dict[str, int])
    """Lines that set a real attribute to an int, by variable, for errors."""
    draws: bool = False

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

    def emission(self, emission: Emission) -> int | None:
        """The output for events of a form; None if the type has another form elsewhere."""
        for index, output in enumerate(self.outputs):
            if isinstance(output, Emission) and output.event_type == emission.event_type:
                return index if output == emission else None
        self.outputs.append(emission)
        return len(self.outputs) - 1

    def shown(self, shown: Shown) -> int:
        """The output for the figures of a form."""
        if shown not in self.outputs:
            self.outputs.append(shown)
        return self.outputs.index(shown)

    def newborn(self, newborn: Newborn) -> int:
        """The output for the newborns of one call of `child`."""
        self.outputs.append(newborn)
        return len(self.outputs) - 1


@dataclass(slots=True)
class LocalNames:
    """The names within one function: of the method, or of a helper.

    `assigned` are variables that certainly have a value; None where the code is not reached.
    """

    origin: Origin
    references: dict[str, Reference]
    kinds: dict[str, ValueKind] = field(default_factory=dict[str, ValueKind])
    lists: dict[str, ListSlot] = field(default_factory=dict[str, ListSlot])
    lines: dict[tuple[str, ValueKind], int] = field(
        default_factory=dict[tuple[str, ValueKind], int]
    )
    assigned: set[str] | None = field(default_factory=set[str])
    reads: dict[str, Variable] = field(default_factory=dict[str, Variable])
    """Variables of the row that a helper is passed, by name."""
    helper: bool = False
    result: ValueKind | None = None
    litters: dict[str, list[int]] = field(default_factory=dict[str, list[int]])
    """Newborns collected in a variable: their outputs."""
    loops: int = 0
    names: Iterator[int] = field(default_factory=lambda: iter(range(1_000_000)))

    @property
    def int_lines(self) -> dict[str, int]:
        """Lines that set a local variable to an int, by variable, for errors."""
        return {
            f"v_{name}": line for (name, kind), line in self.lines.items() if kind is ValueKind.INT
        }

    def temporary(self) -> str:
        """The name of a new variable of the generated function."""
        return f"t_{next(self.names)}"


def joined(first: ValueKind, second: ValueKind) -> ValueKind | None:
    """The kind of a variable that has values of both kinds; None if there is none."""
    if first is second:
        return first
    return ValueKind.MIXED if first.number and second.number else None


def limit_of(declared: Type) -> Limit:
    """The limits of a declared type."""
    if declared.range is None:
        return Limit()
    return Limit(declared.range.least, declared.range.most)


def event_type_of(function: Callable[..., Any], name: str) -> EventType | None:
    """The event type of a name in the module of a function, which has the types of its data."""
    scope: Mapping[str, Any] = getattr(function, "__globals__", {})
    for value in (*scope.values(), *variables_of(function).values()):
        if isinstance(value, EventType) and value.name == name:
            return value
    return None


def slots_of(names: Mapping[str, ValueKind]) -> tuple[Slot, ...]:
    """Names with kinds, sorted by name."""
    return tuple(Slot(name, kind) for name, kind in sorted(names.items()))


def kind_of(declared: Type) -> ValueKind | None:
    """The kind of values of a declared type; None if a column cannot hold them."""
    return DECLARED.get(declared.kind)
