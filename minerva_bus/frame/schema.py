"""Declarations of messages: encoding, limits and documentation of each field.

A message is a frozen dataclass with a `WIRE`. Its fields are encoded by type, in the order of
declaration; marks beside a type restrict a field or determine where its value is sent:

    count: Annotated[int, AtLeast(1), Note("how many")]

`minerva_bus.wire` compiles encoders, decoders and the tables of PROTOCOL.md from this.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto


@dataclass(frozen=True, slots=True)
class Wire:
    """Form of a message: `[name, item, ...]`, or `[name, {field: value}]` if `keyed`.

    `on`: keys on which it is published. `answers`: the message to which it replies.
    `max_bytes`, `max_values`: names of the limits (minerva_bus.wire.limits) if a member sends it.
    `awaited`: a frame may wait for it, so it is exempt from limits per second.
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
    """Minimum of a number; the default is 0 for an int, and none for a float."""

    value: int


@dataclass(frozen=True, slots=True)
class AtMost:
    """Maximum number of values in a list or map: the name of a field of Limits."""

    limit: str


@dataclass(frozen=True, slots=True)
class Within:
    """The value shares the map of another field, under different keys."""

    field: str


@dataclass(frozen=True, slots=True)
class Note:
    """Description of a field in PROTOCOL.md."""

    text: str


class Mark(Enum):
    """Properties of a field that do not follow from its type."""

    FROM_KEY = auto()
    """Not in the message: part of the key on which it is published."""

    LOCAL = auto()
    """Not in the message: set by the receiving process."""

    OPTIONAL = auto()
    """May be missing in a keyed message; then its default applies."""

    TOPICS = auto()
    """Names of sensor topics, which are parts of keys."""

    EVENT_TYPES = auto()
    """Names of event types."""

    SHOWN = auto()
    """Texts that are shown to people, on one line."""

    GENERATED = auto()
    """Events of a generator, of which only a limited number may be outside columns."""

    EMITTED = auto()
    """Events of agents, of which only a limited total may be outside columns."""

    VIEW = auto()
    """Strings without agents."""

    SLOTS = auto()
    """A string whose agents have no state and no scope."""
