"""How a message declares what it is on the wire.

A message is a frozen dataclass with a `WIRE`. Its fields travel in the order in which they are
declared, by their types; marks beside a type restrict a field, or say where its value travels:

    count: Annotated[int, AtLeast(1), Note("how many")]

`minerva_bus.wire` compiles encoders, decoders and the tables of PROTOCOL.md from this.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto


@dataclass(frozen=True, slots=True)
class Wire:
    """A message as it travels: `[name, item, ...]`, or `[name, {field: value}]` where `keyed`.

    `on` lists the keys that it is published on, and `answers` the message that asks for it.
    `max_bytes` and `max_values` name the limits (minerva_bus.wire.limits) of one from a member.
    A frame may wait for an `awaited` message, which therefore no limit per second holds back.
    """

    name: str
    on: tuple[str, ...]
    meaning: str
    answers: str = ""
    keyed: bool = False
    max_bytes: str = "small_bytes"
    max_values: str = "values"
    awaited: bool = False


@dataclass(frozen=True, slots=True)
class AtLeast:
    """The least value of a number; without it an int is 0 or more, and a float any finite one."""

    value: int


@dataclass(frozen=True, slots=True)
class AtMost:
    """The limit on the number of values in a list or map, by its name in Limits."""

    limit: str


@dataclass(frozen=True, slots=True)
class Within:
    """The value travels in the item of another field: both have different keys of one map."""

    field: str


@dataclass(frozen=True, slots=True)
class Note:
    """What PROTOCOL.md says about a field."""

    text: str


class Mark(Enum):
    """Properties of a field that its type does not tell."""

    FROM_KEY = auto()
    """Not in the message: the key that the message came on holds it."""

    LOCAL = auto()
    """Not in the message: the receiving process sets it."""

    OPTIONAL = auto()
    """May be missing from a keyed message, and then has its default."""

    GENERATED = auto()
    """Events of a generator: few that are not in columns."""

    EMITTED = auto()
    """Events of agents: few that are not in columns, all in all."""

    VIEW = auto()
    """Strings without agents."""

    SLOTS = auto()
    """A string whose agents have neither state nor scope."""
