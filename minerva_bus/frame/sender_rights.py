"""What the senders of events may send: by whom, for whom, and how much.

`SenderRights` has the agents in whose name a generator may send events, `OrderRules` the events
that people and guests may send, `UnknownReceivers` the receivers that the string never had.

`EventWork` weighs events by the work that they cause at hosts. A message that costs its sender and
the coordinator little may cost the hosts much: an event without receivers goes to every agent of
the world, and each evaluates its condition. So an event counts as several of the limited single
events if hosts have much work with it. Section 14 of PROTOCOL.md has the rules. A weight depends on
the event and the string alone, not on the time that a host needs.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache, cached_property
from itertools import islice
from typing import Final, cast

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import nearest
from minerva_bus.frame import messages as m
from minerva_bus.frame.composition import Composition, ids_of
from minerva_bus.frame.member_table import Members
from minerva_bus.frame.world_state import Phase, Progress, WorldSpec
from minerva_bus.grammar.columns import values_of
from minerva_bus.grammar.events import AnyEvent, Event, Events, chosen, first_of, senders_of
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.scene import Scene, Value
from minerva_bus.grammar.types import Of
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.values import fast_dataclass
from minerva_bus.wording import counted

ID: Final = "#"
"""Prefix of an entry of `speaks_for` that is the id of an agent, not a kind."""


@fast_dataclass
class SenderRights:
    """The senders that generators may use.

    `speaks_for`: by member, the kinds of agents and the `#id`s of agents in whose name it may send
    events. Any other member only sends events without a sender.
    """

    speaks_for: Mapping[str, tuple[str, ...]]
    composition: Composition

    def objection(self, member: str, events: Sequence[AnyEvent]) -> str:
        """Reason why a member may not send these events, or an empty string.

        Events from agents that are no longer in the string do not count as a violation of a member
        with such rights, because an agent may just have died: `kept` drops these events.
        """
        allowed = self.speaks_for.get(member, ())
        for event in events:
            senders = senders_of(event)
            if senders is None:
                continue
            wrong = ~self._may(senders, allowed)
            if allowed:
                # Only existing agents that the member may not represent are a violation.
                wrong &= self.composition.kinds(senders) != ""
            if wrong.any():
                sender = senders[int(np.argmax(wrong))]
                whom = f"only for {', '.join(allowed)}" if allowed else "only for itself"
                return (
                    f"it sent {event.type} from #{sender[:64]}, but it speaks {whom};"
                    f" speaks_for under [process.{member}] names others"
                )
        return ""

    def kept(self, member: str, events: Sequence[AnyEvent]) -> list[AnyEvent]:
        """The events without sender, or whose sender is an agent that the member may represent."""
        allowed, kept = self.speaks_for.get(member, ()), list[AnyEvent]()
        for event in events:
            senders = senders_of(event)
            rows = None if senders is None else self._may(senders, allowed)
            if rows is None or rows.all():
                kept.append(event)
            else:
                kept += chosen(event, np.flatnonzero(rows))
        return kept

    def _may(self, senders: Ids, allowed: Sequence[str]) -> NDArray[np.bool_]:
        kinds = self.composition.kinds(senders)
        # A sender outside of the string has an empty kind, which no entry names.
        may = np.isin(kinds, [name for name in allowed if not name.startswith(ID)])
        ids = [name.removeprefix(ID) for name in allowed if name.startswith(ID)]
        if ids:
            may |= (Ids.of(ids).rows_of(senders) >= 0) & (kinds != "")
        return may


MAX_LISTED: Final = 12


class OrderRules:
    """Which events people and guests may send, by the members and the string that a world has."""

    def __init__(
        self, world: WorldSpec, now: Progress, members: Members, composition: Composition
    ) -> None:
        self._world = world
        self._now = now
        self._members = members
        self._composition = composition

    def refusal_of_order(self, event_type: str) -> str:
        """Reason for rejecting people's events of a type, or an empty string.

        They may send event types that a generator takes as orders, that the world file lists, or
        that neither a generator makes nor a norm sends. All other events are measured or computed;
        sent from a terminal they would be false statements about the world.
        """
        reserved, members = self._reservation(event_type), self._members
        if reserved:
            return f'{reserved}, or give it a process with service = "orders"'
        # A generator that joins later may make events of this type by itself.
        if self._now.phase is not Phase.WAITING:
            return ""
        unknown = [member.name for member in members if member.expected and member.hello is None]
        allowed = event_type in self._world.people or members.takers(event_type)
        if unknown and not allowed:
            return (
                f"whether people may send {event_type} depends on members that have not joined yet:"
                f" {', '.join(unknown[:5])}; send it when the world runs"
            )
        return ""

    def refusal_of_guest(self, hello: m.Hello, event_types: Iterable[str]) -> str:
        """Reason for rejecting these event types of an attached generator, or an empty string.

        One that stands for people, such as a keyboard, may send what people may send; another may
        be a sensor, but no norm. What a process of the world file sends is the choice of this file.
        """
        reserves = self._reservation if hello.people else self._reservation_by_norms
        reasons = (reserves(event_type) for event_type in dict.fromkeys(event_types))
        reserved = next(filter(None, reasons), "")
        return reserved and f"{reserved}, or make {hello.member} a process of it"

    def _reservation(self, event_type: str) -> str:
        """Why an event type is not for people, and how to allow it; or an empty string."""
        members = self._members
        # An attached generator that takes orders cannot allow what the world file does not.
        if event_type in self._world.people or any(
            map(members.is_process, members.takers(event_type))
        ):
            return ""
        makers = ", ".join(members.makers(event_type))
        return self._reservation_by_norms(event_type) or (makers and _reserved(event_type, makers))

    def _reservation_by_norms(self, event_type: str) -> str:
        """Why an event type is for norms alone, and how to allow it; or an empty string."""
        if event_type in self._world.people:
            return ""
        norms = [norm for norm in self._world.norms if event_type in norm.sends]
        names = ", ".join(norm.name for norm in norms[:MAX_LISTED])
        return names and _reserved(event_type, f"the norm{'s'[: len(norms) > 1]} {names}")

    def without_effect(self, event: Event) -> str:
        """Why an order can change nothing, or an empty string: no receiver responds to it."""
        vocabulary = self._world.vocabulary
        if vocabulary.events[event.type].visual or self._members.takers(event.type):
            return ""
        kinds = {self._composition.kind(receiver) for receiver in event.receivers} - {""}
        responding = [
            name for name, kind in vocabulary.kinds.items() if event.type in kind.subscribes
        ]
        if not (kinds or {*vocabulary.kinds}).isdisjoint(responding):
            return ""
        if not responding:
            return f"no agent kind of this world responds to {event.type}"
        return (
            f"no {' or '.join(sorted(kinds))} responds to {event.type}; {listed(responding)} does"
        )

    def unknown_value(self, event: Event, known_by: dict[Of, set[str]] | None = None) -> str:
        """Reason for rejecting an order with a value that the world lacks, or an empty string.

        `known_by` keeps the values of the string for further events at the same time.

        It compares the order with the values that the string has for the event's type. A string
        without such a value is no reason to reject it, because objects that a robot detects are not
        in it.
        """
        for field in self._world.vocabulary.events[event.type].fields.all:
            source = field.type.source
            if source is None:
                continue
            known_by = {} if known_by is None else known_by
            known = known_by.get(source)
            if known is None:
                known = known_by[source] = set(map(str, values_of(self._composition.scene, source)))
            value: object = event.data[field.name]
            texts = cast("tuple[str, ...]", value if isinstance(value, tuple) else (value,))
            for text in texts:
                # No agent could carry out an order with an unknown name, such as a misspelt
                # marker.
                if known and text not in known:
                    names = sorted(known)
                    return (
                        f"{event.type}: {field.name} is {text[:64]!r}, but no {source.symbol} of"
                        f" the world has this {source.parameter}; expected"
                        f" {listed(names)}{nearest(text, names)}"
                    )
        return ""


def _reserved(event_type: str, sources: str) -> str:
    return (
        f"{event_type} comes from {sources}, so people may not send it; to let them,"
        f' write people = ["{event_type}"] under [world] in the world file'
    )


def listed(names: Iterable[str]) -> str:
    """The first names of many, for a message."""
    shown = list(names)
    more = len(shown) - MAX_LISTED
    return ", ".join(shown[:MAX_LISTED]) + (f" or one of {more} more" if more > 0 else "")


MAX_SINGLE_EVENTS: Final = 2_000
"""Maximum events of one generator, outside columns, in a frame."""

MAX_HOST_EVENTS: Final = 8_000
"""Maximum events of one host, outside columns, in a frame."""

STEPS_PER_WEIGHT: Final = 250
"""Steps of hosts for which an event weighs 1 more; a step is an event for an agent."""

PART_STEPS: Final = 10
"""Steps of an event for a part of a population, which is evolved by columns."""

ROWS_PER_STEP: Final = 20
"""Agents in columns that take one step more."""

LETTERS_PER_STEP: Final = 8
"""Characters of a condition that take as long as the event itself: about one comparison."""

BYTES_PER_WEIGHT: Final = 32_768
"""Bytes of data for which an event weighs 1 more: a frame has all of its events in one message."""

SEARCHED: Final = 10_000
"""Events of a batch of a host up to which its receivers are searched for in the string."""

FEW: Final = 8
"""Events of a message up to which they are not weighed if none has a condition."""


class EventWork:
    """Weighs events by the agents that the string has now.

    `most_of_generator`, `most_of_host`: the limits of a member's events in a frame.
    """

    def __init__(self, composition: Composition, vocabulary: Vocabulary) -> None:
        self._composition = composition
        self._vocabulary = vocabulary
        self._responding = cache(self._kinds_of)
        self.most_of_generator: int = MAX_SINGLE_EVENTS
        self.most_of_host: int = MAX_HOST_EVENTS

    def allow(self, of_generator: int, of_host: int) -> None:
        """Set the limits of a world file."""
        self.most_of_generator, self.most_of_host = of_generator, of_host

    def objection(self, events: Sequence[AnyEvent], most: int, limit: str) -> str:
        """Reason why a member may not send these events in one message, or an empty string.

        `limit`: the name of the limit `most`.
        """
        weight = sum(map(self.weight, events))
        return self.over(weight, most, limit, events) if weight > most else ""

    def objection_to_host(self, events: Iterable[AnyEvent]) -> str:
        """As `objection`, for the events that the agents of a host send in a frame."""
        # A search for the receivers of a large population, in each frame, would cost more than all
        # else here, and its agents send to agents like them.
        weighed = [event for event in events if event.receivers is None or len(event) <= SEARCHED]
        return self.objection(weighed, self.most_of_host, "host_events")

    def over(self, weight: int, most: int, limit: str, events: Iterable[AnyEvent]) -> str:
        """Reason for refusing events of a weight over `most`."""
        return (
            f"events weigh {weight} by the work of hosts, over {most}:"
            f" {self.heaviest(events)}; name fewer receivers, shorten conditions and data, or raise"
            f" {limit} in [limits]"
        )

    def heaviest(self, events: Iterable[AnyEvent]) -> str:
        """The most expensive of some events, for a message."""
        event = max(events, key=self.steps)
        condition = f" with a condition of {len(event.condition)} characters"
        return (
            f"the heaviest is {event.type}, delivered {counted(self._deliveries(event), 'time')}"
            f"{condition if event.condition else ''}"
        )

    def weight(self, event: AnyEvent) -> int:
        """The number of single events as which an event or a batch counts, at least 1."""
        return 1 + self.steps(event) // STEPS_PER_WEIGHT + _size(event) // BYTES_PER_WEIGHT

    def steps(self, event: AnyEvent) -> int:
        """The work of hosts with an event or a batch."""
        return self._deliveries(event) * (1 + len(event.condition) // LETTERS_PER_STEP)

    def _deliveries(self, event: AnyEvent) -> int:
        """The agents to which an event goes; fewer if they are in columns."""
        if not event.receivers:
            return len(event) * self._everyone(event.type)
        if isinstance(event, Event):
            return len(event.receivers)
        return self._of_batch(event.receivers)

    def _everyone(self, event_type: str) -> int:
        kinds, composition = self._responding(event_type), self._composition
        steps = sum([count for kind, count in composition.single.items() if kind in kinds])
        for part in composition.parts.values():
            steps += PART_STEPS + part.count // ROWS_PER_STEP if part.symbol in kinds else 0
        return steps

    def _kinds_of(self, event_type: str) -> frozenset[str]:
        kinds = self._vocabulary.kinds.items()
        return frozenset(name for name, kind in kinds if event_type in kind.subscribes | kind.views)

    def _of_batch(self, receivers: Ids) -> int:
        steps = len(receivers)
        for part in self._composition.parts.values():
            if part.ids is receivers:
                return PART_STEPS + steps // ROWS_PER_STEP
            rows = ids_of(part).rows_of(receivers)
            there = rows[rows >= 0]
            if len(there):
                # A population takes a batch in as many passes as one of its agents has events.
                steps += int(np.bincount(there).max()) * PART_STEPS + len(there) // ROWS_PER_STEP
                steps -= len(there)
        return steps


def _size(event: AnyEvent) -> int:
    """The approximate number of bytes of the data of an event or a batch."""
    if isinstance(event, Events):
        return sum(column.array.nbytes for column in event.columns)
    return sum(map(_length, event.values))


def _length(value: Value) -> int:
    if isinstance(value, str):
        return len(value)
    if isinstance(value, tuple):
        return sum(map(_length, value))
    return value.nbytes if isinstance(value, np.ndarray) else 8


def are_light(events: Sequence[AnyEvent]) -> bool:
    """Whether events are so few and simple that nothing is gained by weighing them."""
    return len(events) <= FEW and not any(e.condition or isinstance(e, Events) for e in events)


EVENTS: Final = "events"
"""The name under which they are logged."""

MAX_NAMES: Final = 10_000
"""Agents up to which an error compares their ids with an unknown one."""

MAX_RECEIVERS: Final = 1_000
"""Receivers of a batch that are compared with the string."""


def unknown_agent(composition: Composition, receiver: str, otherwise: str = "") -> str:
    """`#receiver`, shortened, with a hint; `otherwise` is one if no agent has a similar id."""
    known = sorted(islice(composition.agents(), MAX_NAMES))
    return f"#{receiver[:64]}{nearest(receiver, known, otherwise)}"


class UnknownReceivers:
    """The receivers of events that neither the string nor the first string `w` has.

    Agents die, and others cannot know it at once, so events for them are no mistake. The ids of
    newborns begin with those of their ancestors.
    """

    def __init__(self, w: Scene) -> None:
        self._w = w
        self._reported = set[str]()

    @cached_property
    def _first(self) -> Composition:
        return Composition(self._w)

    def problems(self, events: Iterable[AnyEvent], composition: Composition) -> Iterator[str]:
        """A line for each event type with such a receiver, once for each type."""
        single: dict[str, AnyEvent] = {}
        for event in events:
            if not event.receivers or event.type in self._reported:
                continue
            if isinstance(event, Events):
                first = event.receivers
                if len(first) > MAX_RECEIVERS:
                    first = first.take(slice(MAX_RECEIVERS))
                receiver = composition.first_missing(first)
                if receiver is not None:
                    single.setdefault(receiver, event)
            else:
                for receiver in event.receivers[:MAX_RECEIVERS]:
                    single.setdefault(receiver, event)
        missing = single.keys() - composition.home_of_each(single).keys() if single else ()
        for receiver in sorted(missing):
            event = single[receiver]
            if event.type not in self._reported and not self._was_there(receiver):
                self._reported.add(event.type)
                sender = first_of(event).sender
                by = f" of #{sender}" if sender else ""
                whom = unknown_agent(composition, receiver)
                yield f"{event.type}{by} goes to an agent that the string does not have: {whom}"

    def _was_there(self, receiver: str) -> bool:
        parts = receiver.split(":")
        ancestors = [":".join(parts[:count]) for count in range(1, len(parts) + 1)]
        return bool(self._first.home_of_each(ancestors))
