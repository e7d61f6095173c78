"""Orders: the events that people may send, and what becomes of them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Final, cast

from minerva_bus.errors import nearest
from minerva_bus.frame.composition import Composition
from minerva_bus.frame.members import Members
from minerva_bus.frame.messages import Hello
from minerva_bus.frame.world_state import Phase, Progress, WorldSpec
from minerva_bus.grammar.columns import values_of
from minerva_bus.grammar.digest import same_values
from minerva_bus.grammar.events import AnyEvent, Event, single
from minerva_bus.grammar.types import Of
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.world.delivery import Priority
from minerva_bus.world.operator import OrderStatus

_MAX_LISTED = 12


class OrderRules:
    """Which events people and guests may send, by the members and the string that a world has."""

    def __init__(
        self,
        world: WorldSpec,
        now: Progress,
        members: Members,
        composition: Composition,
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
        unknown = [member.name for member in members if member.expected and member.hello is None]
        allowed = event_type in self._world.people or members.takers(event_type)
        # A generator that joins later may make events of this type by itself.
        if unknown and not allowed and self._now.phase is Phase.WAITING:
            return (
                f"whether people may send {event_type} depends on members that have not joined yet:"
                f" {', '.join(unknown[:5])}; send it when the world runs"
            )
        return ""

    def refusal_of_guest(self, hello: Hello, event_types: Iterable[str]) -> str:
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
        names = ", ".join(norm.name for norm in norms[:_MAX_LISTED])
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
    more = len(shown) - _MAX_LISTED
    return ", ".join(shown[:_MAX_LISTED]) + (f" or one of {more} more" if more > 0 else "")


MAX_ORDERS: Final = 1000
"""Orders whose fates are kept; older ones are dropped."""

_BY_NAME: Final = Priority()


@dataclass(slots=True)
class _Order:
    event: Event
    status: OrderStatus
    accepted: int = -1
    """The frame that it counts in."""


class OrderFates:
    """The last orders of people, with their fates.

    An order waits until a frame takes it: then it is accepted, or a norm rejects it. It is dropped
    if the frame ends a host twice, and is repeated without the events of people. An event type
    may declare that it `completes` or `fails` orders of some types. Such an event of an agent
    concerns the last order of these types that was accepted before, that is addressed to this agent
    or to all, and whose data are equal to those of the event where both have data of one name; and
    all orders equal to it, because people may give the same order. One agent that fails an order to
    all does not end it: another agent may still complete it.

    An event type may also declare that such an order `replaces` orders of some types: those that
    were before it, that have not ended, whose receivers all receive it, and that are not equal.

    Args:
        vocabulary: the declarations of event types.
        order: the order of the events of one frame.

    """

    def __init__(self, vocabulary: Vocabulary, order: Priority = _BY_NAME) -> None:
        self._order = order
        self._completes = {e.name: e.completes for e in vocabulary.events.values() if e.completes}
        self._fails = {e.name: e.fails for e in vocabulary.events.values() if e.fails}
        self._replaces = {e.name: e.replaces for e in vocabulary.events.values() if e.replaces}
        ends = (*self._completes.values(), *self._fails.values(), *self._replaces.values())
        self._ended = frozenset[str]().union(*ends)
        self._orders: dict[int, _Order] = {}
        self._open: set[int] = set()
        self._accepted: list[int] = []
        """The orders that this frame has accepted."""
        self._last_number = 0
        self._last_change = 0

    def arrive(self, event: Event, person: str, frame: int) -> int:
        """Note an order that waits for a frame; returns its number."""
        self._last_number += 1
        number = self._last_number
        status = OrderStatus(
            number,
            self._next_change(),
            person,
            str(event),
            event.type,
            "waiting",
            frame,
        )
        self._orders[number] = _Order(event, status)
        if len(self._orders) > MAX_ORDERS:
            oldest = next(iter(self._orders))
            del self._orders[oldest]
            self._open.discard(oldest)
        return number

    def judge(
        self, event: Event, person: str, frame: int, state: str = "accepted", by: str = ""
    ) -> None:
        """Note that a frame accepts an order, a norm rejects it, or the frame drops it again."""
        before = ("accepted", frame) if state == "dropped" else ("waiting", -1)
        judged = (
            number
            for number, order in self._orders.items()
            if (order.status.state, order.accepted) == before
            and order.status.person == person
            and order.event == event
        )
        number = next(judged, None)
        if number is None:  # It arrived at an earlier coordinator of this world.
            number = self.arrive(event, person, frame)
        self._orders[number].accepted = frame
        # Open even if no agent reports about it: its frame may still drop it.
        self._change(number, state, frame, by, is_open=state == "accepted")
        if state == "accepted":
            self._accepted.append(number)
        elif state == "dropped" and number in self._accepted:
            self._accepted.remove(number)

    def end_frame(self, frame: int, events: Iterable[AnyEvent]) -> list[OrderStatus]:
        """Note what the accepted orders and the events of a frame end; returns these orders."""
        for number in self._accepted:
            order = self._orders.get(number)
            if order is not None and order.event.type not in self._ended:
                self._change(number, "accepted", frame, "", is_open=False)
        changed = self._replace(frame) if self._accepted else []
        if self._open:
            changed += self._report(frame, events)
        return changed

    def _replace(self, frame: int) -> list[OrderStatus]:
        """Note which orders those that were accepted in a frame replace."""
        # As agents receive them, whereas they were judged person by person.
        accepted = sorted(self._accepted, key=self._place)
        self._accepted.clear()
        changed: list[OrderStatus] = []
        for position, number in enumerate(accepted):
            by = self._orders.get(number)
            if by is None or by.event.type not in self._replaces:
                continue
            later = accepted[position:]
            for other in sorted(self._open.difference(later)):
                if self._is_replaced(self._orders[other].event, by.event):
                    text = by.status.event
                    changed.append(self._change(other, "replaced", frame, text, is_open=False))
        return changed

    def _place(self, number: int) -> tuple[int, str, str, int]:
        order = self._orders.get(number)
        if order is None:  # A later order has displaced it.
            return 0, "", "", number
        return self._order.key(order.event.type, order.status.person, number)

    def _is_replaced(self, event: Event, by: Event) -> bool:
        return (
            event.type in self._replaces[by.type]
            and event != by
            and not by.condition
            and (not by.receivers or set() < set(event.receivers) <= set(by.receivers))
        )

    def _report(self, frame: int, events: Iterable[AnyEvent]) -> list[OrderStatus]:
        """Note the reports among the events of a frame."""
        changed: list[OrderStatus] = []
        for event in single(each for each in events if self._is_report(each.type)):
            sender = event.sender
            for number in self._matches(event, self._completes.get(event.type, ()), frame):
                changed.append(self._change(number, "done", frame, sender, is_open=False))
            for number in self._matches(event, self._fails.get(event.type, ()), frame):
                to_all = not self._orders[number].event.receivers
                changed.append(self._change(number, "failed", frame, sender, is_open=to_all))
        return changed

    def changed_since(self, change: int) -> tuple[OrderStatus, ...]:
        """The orders that have changed after the change of this number, oldest change first."""
        statuses = [order.status for order in self._orders.values()]
        changed = [status for status in statuses if status.change > change]
        return tuple(sorted(changed, key=lambda status: status.change))

    def _is_report(self, event_type: str) -> bool:
        return event_type in self._completes or event_type in self._fails

    def _matches(self, report: Event, types: tuple[str, ...], frame: int) -> list[int]:
        """The open orders that an agent's report concerns."""
        if not report.sender:  # What a person or a generator sends is not a report of an agent.
            return []
        concerned = [n for n in sorted(self._open) if self._concerns(report, types, n, frame)]
        last = self._orders[concerned[-1]].event if concerned else None
        return [n for n in concerned if self._orders[n].event == last]

    def _concerns(self, report: Event, types: tuple[str, ...], number: int, frame: int) -> bool:
        order, data = self._orders[number].event, report.data
        return (
            order.type in types
            and self._orders[number].accepted < frame
            and report.sender in (order.receivers or (report.sender,))
            and all(
                same_values((data[name],), (value,))
                for name, value in order.data.items()
                if name in data
            )
        )

    def _change(
        self, number: int, state: str, frame: int, by: str, *, is_open: bool
    ) -> OrderStatus:
        order, change = self._orders[number], self._next_change()
        order.status = replace(
            order.status, state=state, frame=frame, by=by, change=change, open=is_open
        )
        if is_open:
            self._open.add(number)
        else:
            self._open.discard(number)
        return order.status

    def _next_change(self) -> int:
        self._last_change += 1
        return self._last_change
