"""How much may come over the bus, and how much work any of it may be: every limit, in one place.

PROTOCOL.md, section 14, has the same numbers, which a test compares with these.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from minerva_bus.errors import ProtocolError
from minerva_bus.frame.algorithm import MOST_WAITING
from minerva_bus.frame.core import SINGLE_EVENTS


@dataclass(frozen=True, slots=True)
class Limits:
    """Bounds at the protocol's border; whatever is over one is refused, its sender named.

    A *value* is one item of MessagePack: a list, map, number, text, binary or extension. However
    many values a column has, it is one or a few.

    message_bytes   of a message
    emitted_bytes   of an `emitted`
    small_bytes     of a message that is no `ticked`, `evolved` or `emitted`, and of a question
    values          of a message that is no `ticked` or `evolved`, and of a member in a second, but
                    for answers that a frame waits for
    answer_values   of a `ticked` or `evolved`
    nodes           of a string, or rows of columns
    depth           of scopes within one another
    rows            of all columns of a message
    events          of a message, those in columns as well
    single_events   of a `ticked` or `emitted` that are not in columns, and of those of a
                    free-running generator that a frame takes
    host_events     of an `evolved` that are not in columns
    receivers       of all single events of a `ticked` or `emitted`
    conditions      characters of all different conditions of a `ticked` or `emitted`
    items           values of any message or file, as it is read
    kinds, fields   of a hello: kinds, and attributes of all of them
    names           in a list of a hello
    figures         of a `doing` or `report`
    messages, bytes of a member in a second, but for answers that a frame waits for
    seconds         that the coordinator spends in a second on what a member says, likewise
    hellos          of a member in a second
    all_hellos      of all members in a second
    questions       that wait for an answer
    members         at once
    links           at once
    waiting         events of a free-running generator that wait for a frame
    """

    message_bytes: int = 64 * 1024 * 1024
    emitted_bytes: int = 16 * 1024 * 1024
    small_bytes: int = 256 * 1024
    values: int = 50_000
    answer_values: int = 5_000_000
    nodes: int = 5_000_000
    depth: int = 100_000
    rows: int = 20_000_000
    events: int = 1_000_000
    single_events: int = SINGLE_EVENTS
    host_events: int = 100_000
    receivers: int = 20_000
    conditions: int = 50_000
    kinds: int = 256
    fields: int = 2_000
    names: int = 1_000
    figures: int = 1_000
    messages: int = 5_000
    bytes: int = 128 * 1024 * 1024
    items: int = 64 * 1024 * 1024
    seconds: float = 0.25
    hellos: int = 20
    all_hellos: int = 1_000
    questions: int = 100
    members: int = 3_000
    links: int = 4_000
    waiting: int = MOST_WAITING


DEFAULT: Final = Limits()

ON_DISK: Final = Limits(
    message_bytes=1 << 31,
    emitted_bytes=1 << 31,
    small_bytes=1 << 31,
    values=1 << 31,
    answer_values=1 << 31,
    items=16_000_000,
    nodes=50_000_000,
    rows=500_000_000,
    events=100_000_000,
    single_events=100_000_000,
    host_events=100_000_000,
    receivers=1 << 31,
    conditions=1 << 31,
)
"""A message of a record may hold a whole string, and somebody else may have made the record."""


def check(what: str, count: int, most: int, unit: str, advice: str = "") -> None:
    """Raise ProtocolError where there is more of something than a limit allows."""
    if count > most:
        raise ProtocolError(f"{what} has {count} {unit}, over {most}{advice and f'; {advice}'}")
