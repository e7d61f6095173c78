"""Limits on the size of messages and on the work that they cause.

The table in section 14 of PROTOCOL.md is generated from this module.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cache
from typing import Annotated, Any, Final, get_args, get_type_hints

from minerva_bus.errors import ProtocolError
from minerva_bus.frame.collection import MAX_WAITING
from minerva_bus.frame.messages import Note
from minerva_bus.frame.work import MAX_HOST_EVENTS, MAX_SINGLE_EVENTS

OF_A_HOST: Final = 8
"""Times as many characters of conditions for a host, whose agents each have their own."""


@dataclass(frozen=True, slots=True)
class Configurable:
    """A limit that a world file may set; `least` is the minimum."""

    least: int


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of the protocol; a member that sends a message over a limit is rejected.

    A *value* is one item of MessagePack: a list, map, number, text, binary or extension. A column
    is one or a few values for any number of rows. The limits apply to messages of members; the
    notes describe the count of each one.
    """

    message_bytes: Annotated[int, Note("bytes of a message"), Configurable(1024)] = 64 << 20
    # A frame waits for it.
    tick_bytes: Annotated[int, Note("bytes of a `ticked`"), Configurable(1024)] = 8 << 20
    emitted_bytes: Annotated[int, Note("bytes of an `emitted`"), Configurable(1024)] = 4 << 20
    small_bytes: Annotated[
        int,
        Note("bytes of any other message of a member except `ticked` and `evolved`; of a question"),
    ] = 256 << 10
    values: Annotated[
        int,
        Note(
            "values of a message of a member other than `ticked` and `evolved`; of a member's"
            " messages in a second"
        ),
        Configurable(100),
    ] = 50_000
    # A frame waits for these. A generator's saved state may be bytes, which are one value. A host
    # reports changes of all of its agents, newborn agents and views.
    tick_values: Annotated[int, Note("values of a `ticked`"), Configurable(1000)] = 50_000
    answer_values: Annotated[
        int,
        Note("values of an `evolved`"),
        Configurable(1000),
    ] = 400_000
    items: Annotated[int, Note("values of any message, including the coordinator's")] = 64 << 20
    nodes: Annotated[int, Note("symbols of a string; rows of columns")] = 5_000_000
    # Scopes are read without recursion, so this is far beyond Python's own limit.
    depth: Annotated[int, Note("nesting of the scopes of a string")] = 100_000
    # In addition to the limits for bytes and values, because a row of a
    # kind without attributes takes no byte.
    rows: Annotated[int, Note("rows of all columns of a message")] = 20_000_000
    events: Annotated[
        int,
        Note("events of a `ticked` or `emitted`, including those in columns"),
        Configurable(1),
    ] = 300_000
    single_events: Annotated[
        int,
        Note(
            "events of a `ticked` or `emitted` that are not in columns; of those of a free-running"
            " generator, in a frame; the weight of all of them, see below"
        ),
        Configurable(1),
    ] = MAX_SINGLE_EVENTS
    host_events: Annotated[
        int,
        Note(
            "events of an `evolved` that are not in columns; agents that it names as senders; the"
            " weight of all of its events"
        ),
        Configurable(1),
    ] = MAX_HOST_EVENTS
    receivers: Annotated[int, Note("receivers of the single events of a `ticked` or `emitted`")] = (
        20_000
    )
    conditions: Annotated[
        int,
        Note(
            "characters of the different conditions of the events of a `ticked` or `emitted`; eight"
            " times as many of an `evolved`"
        ),
    ] = 50_000
    kinds: Annotated[int, Note("kinds of a `hello`")] = 256
    fields: Annotated[int, Note("attributes of all kinds of a `hello`")] = 2_000
    names: Annotated[int, Note("names in each list of a `hello`")] = 1_000
    figures: Annotated[int, Note("figures of a `doing` or `report`")] = 1_000
    messages: Annotated[int, Note("messages of a member in a second"), Configurable(1)] = 5_000
    bytes: Annotated[int, Note("bytes of a member in a second"), Configurable(1024)] = 128 << 20
    seconds: Annotated[
        float, Note("seconds that the coordinator spends in a second on one member's messages")
    ] = 0.25
    stranger_messages: Annotated[
        int, Note("messages of all unknown senders in a second; further ones are only counted")
    ] = 100
    hellos: Annotated[int, Note("`hello`s of a member in a second; changes of its token")] = 20
    all_hellos: Annotated[
        int,
        Note(
            "`hello`s of all members in a second; changes of the tokens of those that take no part"
        ),
    ] = 1_000
    questions: Annotated[
        int, Note("unanswered questions; further ones are answered with an error")
    ] = 100
    members: Annotated[
        int, Note("members, including expected ones; further ones are not greeted")
    ] = 3_000
    links: Annotated[int, Note("links to the coordinator")] = 4_000
    waiting: Annotated[
        int,
        Note(
            "events of a free-running generator that wait for a frame; those over `single_events`"
            " wait for the next frame, further ones are dropped"
        ),
    ] = MAX_WAITING


def limit_notes() -> Mapping[str, str]:
    """Description of the count behind each limit, by its name."""
    return {name: note.text for name, note in _marks(Note).items()}


@cache  # Decoding asks for each answer.
def configurable_limits() -> Mapping[str, int]:
    """Minimum of each limit that a world file may set, by its name."""
    return {name: mark.least for name, mark in _marks(Configurable).items()}


@cache
def _marks(kind: type[Any]) -> Mapping[str, Any]:
    hints = get_type_hints(Limits, include_extras=True)
    marks = {of.name: get_args(hints[of.name])[1:] for of in fields(Limits)}
    return {name: mark for name, every in marks.items() for mark in every if isinstance(mark, kind)}


DEFAULT: Final = Limits()

ON_DISK: Final = Limits(
    message_bytes=1 << 31,
    tick_bytes=1 << 31,
    emitted_bytes=1 << 31,
    small_bytes=1 << 31,
    values=1 << 31,
    tick_values=1 << 31,
    answer_values=1 << 31,
    # Lower than on the bus: a file may have an unknown origin, and each item takes memory.
    items=16_000_000,
    nodes=50_000_000,
    rows=500_000_000,
    events=100_000_000,
    single_events=100_000_000,
    host_events=100_000_000,
    receivers=1 << 31,
    conditions=1 << 31,
)
"""Limits for files: a message of a record may contain a whole string, from an unknown origin."""


def check(what: str, count: int, most: int, unit: str, advice: str = "") -> None:
    """Raise ProtocolError if a count exceeds a limit; `advice` names an alternative."""
    if count > most:
        raise ProtocolError(f"{what} has {count} {unit}, over {most}{advice and f'; {advice}'}")
