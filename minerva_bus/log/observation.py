"""An agent in a record at one frame: its state, what it received lately, and what was rejected."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any, Final

from minerva_bus.grammar.events import Event, first_of
from minerva_bus.grammar.printer import shown_value
from minerva_bus.log.causes import RECENT, Causes, event_text
from minerva_bus.log.explanation import EventSource, rejected_lines
from minerva_bus.log.past_frames import agent_at, end_of, past_frames
from minerva_bus.log.record import Record
from minerva_bus.log.sources import source_of
from minerva_bus.world.agent import Kinds
from minerva_bus.wording import short

MAX_RECEIVED: Final = 40
"""Entries about received events."""


@dataclass(frozen=True, slots=True)
class ReceivedEvents:
    """Events of one type that an agent received in a frame: the first one, and their number."""

    frame: int
    event: str
    count: int
    source: EventSource

    @property
    def text(self) -> str:
        """As a line of text."""
        more = f" and {self.count - 1} more" if self.count > 1 else ""
        return f"frame {self.frame}: {short(self.event)}{more}, from {self.source.text}"


@dataclass(frozen=True, slots=True)
class Observation:
    """An agent at the beginning of `frame`.

    `state` has the values of its attributes as text. `received` are the events of the last frames
    that were for the agent, newest frame first; an event with a condition may not have concerned
    it. `rejected` are events and steps of the agent that norms have rejected in these frames.
    """

    world: str
    agent: str
    kind: str
    frame: int
    state: tuple[tuple[str, str], ...]
    received: tuple[ReceivedEvents, ...]
    rejected: tuple[str, ...] = ()

    @property
    def is_older(self) -> bool:
        """False: what the frames before it lack is not part of the answer."""
        return False

    def plain(self) -> dict[str, Any]:
        """As a JSON object."""
        own = {name: getattr(self, name) for name in self.__slots__}
        received = [asdict(each) for each in self.received]
        rejected = list(self.rejected)
        return {**own, "state": dict(self.state), "received": received, "rejected": rejected}

    def lines(self) -> list[str]:
        """As lines of text."""
        shown = [f"{self.kind}#{self.agent} at the beginning of frame {self.frame}"]
        shown += [f"  {name} = {short(value)}" for name, value in self.state]
        shown.append(f"received in the last {RECENT} frames:" if self.received else NOTHING)
        shown += [f"  {each.text}" for each in self.received]
        return [*shown, *rejected_lines(self.rejected)]


NOTHING: Final = f"it received nothing in the last {RECENT} frames"


def observe_agent(record: Record, kinds: Kinds, name: str, frame: int | None = None) -> Observation:
    """What an agent is when a frame begins, and what it received in the frames before.

    Args:
        record: a record of a run.
        kinds: the classes of the agents, which run again if a norm judges their steps.
        name: id of the agent, without #.
        frame: number of the frame; None: the end of the record.

    Raises:
        RecordError: the record has no such frame or agent.
        ActivityError: code of an agent fails.

    """
    end = end_of(record, frame)
    agent = agent_at(record, name, end)
    past = {each.frame.number: each for each in past_frames(record, end - RECENT, end)}
    causes = Causes(record.description.world, kinds, past)
    newest_first = sorted(past, reverse=True)

    def received() -> Iterator[ReceivedEvents]:
        for number in newest_first:
            counts: dict[str, int] = {}
            first: dict[str, Event] = {}
            for events in causes.received(name, number):
                counts[events.type] = counts.get(events.type, 0) + len(events)
                first.setdefault(events.type, first_of(events))
            for event_type, event in first.items():
                source = source_of(event, past, number, record.description.world.norms)
                text = event_text(event)
                yield ReceivedEvents(number, text, counts[event_type], source)

    return Observation(
        record.description.world.name,
        name,
        agent.symbol,
        end,
        tuple([(attribute, shown_value(agent.state[attribute])) for attribute in agent.names]),
        tuple(each for each, _ in zip(received(), range(MAX_RECEIVED), strict=False)),
        tuple(causes.rejected(name, newest_first)),
    )
