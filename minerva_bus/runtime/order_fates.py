"""What becomes of the orders of people."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Final

from minerva_bus.grammar.digest import same_values
from minerva_bus.grammar.events import AnyEvent, Event, single
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.world.delivery import Priority
from minerva_bus.world.operator import OrderStatus

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
