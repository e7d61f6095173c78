"""What determines a frame, besides the string: its inputs, and the state from the frame before.

Journals and records have all of it: the names of the sources of events that are not members, the
inputs of a frame, and the checkpoint between two frames.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final, TypeAlias

from minerva_bus.frame.composition import Layout
from minerva_bus.frame.messages import EvolveReply, TickReply, fast_dataclass
from minerva_bus.grammar.events import AnyEvent
from minerva_bus.world.norms import SOURCE

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


OrdersBySource: TypeAlias = Mapping[str, Sequence[AnyEvent]]
"""People's orders by source."""


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


@fast_dataclass
class FrameInputs:
    """Input of the frame algorithm in one frame, as far as it was used.

    `due`: visual event types for which a device requested a view.
    `ticked`: replies of members in step (step 2), by member.
    `taken`: events of other sources, by source.
    `layout`: the division of populations into fragments.
    `replies`: replies of hosts (steps 5 and 6), in the order in which they were merged.
    `waiting`: events by source that arrived during the frame and count in the next one.
    `people`: sources whose events count as sent by people (for norms).
    `answers`: number of replies to the first request, and to each repeated request after a norm
    rejected an outcome.
    `left_out`: fragments without a reply.
    """

    frame: int
    due: tuple[str, ...]
    ticked: Mapping[str, TickReply]
    taken: Mapping[str, Sequence[AnyEvent]]
    layout: Layout
    replies: Sequence[EvolveReply]
    waiting: Mapping[str, Sequence[AnyEvent]]
    people: tuple[str, ...] = ()
    answers: tuple[int, ...] = ()
    left_out: tuple[str, ...] = ()

    @property
    def complete(self) -> bool:
        """Whether these inputs include all replies, so that the frame awaits no member."""
        return bool(self.answers)

    @property
    def without_replies(self) -> FrameInputs:
        """These inputs without the results of agents, so that hosts have to compute them again."""
        # Empty `answers` mark the inputs as incomplete, so the frame sends requests to its hosts.
        return replace(self, layout=(), replies=(), waiting={}, answers=(), left_out=())


@fast_dataclass
class RecordedFrame:
    """A frame of a recorded run.

    `events`: in order. `delta`: changes of the string, as plain data (log/entries.py).
    `digest`: of the string after the frame. `seconds`: when the frame ended, by the clock, since
    the record began. `inputs`: without the replies of hosts; None unless recorded and requested.
    """

    number: int
    events: tuple[AnyEvent, ...]
    delta: list[Any]
    digest: bytes
    seconds: float
    inputs: FrameInputs | None = None


HALTED: Final = "~halted"
"""Key in `Checkpoint.saved` for the agents whose actions the last views must not execute."""


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """State beside the string between two frames; `frame` is the next one.

    `saved`: data saved by members in step in their last complete frame, by member.
    `emitted`: events that agents sent, and `inbox`: events from other sources, by source; both
    count in the next frame.
    `reached`: agents that reached the event of `until`; `reaching`: kinds that can reach it.
    """

    frame: int = 0
    saved: Mapping[str, Mapping[str, Any]] = field(default_factory=dict[str, Mapping[str, Any]])
    emitted: tuple[AnyEvent, ...] = ()
    inbox: Mapping[str, tuple[AnyEvent, ...]] = field(
        default_factory=dict[str, tuple[AnyEvent, ...]]
    )
    reached: frozenset[str] = frozenset()
    reaching: frozenset[str] = frozenset()

    @property
    def sent(self) -> dict[str, tuple[AnyEvent, ...]]:
        """What agents and norms sent in the frame before, by source: events of the next frame."""
        return {AGENTS: self.emitted, SOURCE: self.inbox.get(SOURCE, ())}
