"""Names of the sources of a frame's events that are not members, also in journals and records."""

from __future__ import annotations

from typing import Final

PEOPLE: Final = "~order"
"""Source of people's events, to which norms apply as to those of generators; of a person with a
name it is `~order:NAME`."""

AGENTS: Final = "#"
"""Source of all events that agents send; no generator can have this name."""

DEVICES: Final = "~device"
"""Source of the visual events that devices request by their `when`."""

HANDED_OVER: Final = "~handed"
"""Key of the orders taken by generators in the inputs of a frame."""


DROPPED: Final = "~dropped:"
"""Prefix, in the inputs of a frame, of a source whose events were left out of it after all."""


def source_of(person: str) -> str:
    """The source of a person's events; "" is a person without a name."""
    return f"{PEOPLE}:{person}" if person else PEOPLE


def is_people(source: str) -> bool:
    """Whether events of a source are sent by people."""
    return source.partition(":")[0] == PEOPLE


def name_of(source: str) -> str:
    """The name of the person who is a source; empty for a person without a name."""
    return source.partition(":")[2]


def person_of(source: str) -> str:
    """The name of the person who is a source, or `people`."""
    return name_of(source) or "people"


def is_handed_over(source: str) -> bool:
    """Whether a source of a record has orders that a generator took."""
    return source.partition(":")[0] == HANDED_OVER


def is_dropped(source: str) -> bool:
    """Whether a source of a record has events that were left out of its frame."""
    return source.startswith(DROPPED)


def is_set_aside(source: str) -> bool:
    """Whether events of a source of a record are not among those that hosts got."""
    return is_handed_over(source) or is_dropped(source)


def handed_over(source: str) -> str:
    """The name under which a record has the orders of a source that a generator took."""
    return HANDED_OVER + source.removeprefix(PEOPLE)


def people_of(handed: str) -> str:
    """The inverse of `handed_over`."""
    return PEOPLE + handed.removeprefix(HANDED_OVER)
