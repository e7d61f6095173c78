"""The fates of people's orders: whether a frame takes them, and what agents report about them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Final

from minerva_bus.grammar.batch import AnyEvent, single
from minerva_bus.grammar.digest import same_values
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.world.operator import OrderStatus

MAX_ORDERS: Final = 1000
"""Orders whose fates are kept; older ones are dropped."""


@dataclass(slots=True)
class _Order:
    event: Event
    status: OrderStatus
    accepted: int = -1
    """The frame that it counts in."""


class OrderFates:
    """The last orders of people, with their fates.

    An order waits until a frame takes it: then it is accepted, or a norm rejects it. An event type
    may declare that it `completes` or `fails` orders of some types. Such an event of an agent
    concerns the last order of these types that was accepted before, that is addressed to this agent
    or to all, and whose data are equal to those of the event where both have data of one name; and
    all orders equal to it, because people may give the same order. One agent that fails an order to
    all does not end it: another agent may still complete it.
    """

    def __init__(self, vocabulary: Vocabulary) -> None:
        self._completes = {e.name: e.completes for e in vocabulary.events.values() if e.completes}
        self._fails = {e.name: e.fails for e in vocabulary.events.values() if e.fails}
        reports = (*self._completes.values(), *self._fails.values())
        self._reported = frozenset[str]().union(*reports)
        self._orders: dict[int, _Order] = {}
        self._open: set[int] = set()
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

    def judge(self, event: Event, person: str, frame: int, norm: str = "") -> None:
        """Note that an order counts in a frame, or the norm that rejects it."""
        waiting = (
            number
            for number, order in self._orders.items()
            if order.status.state == "waiting"
            and order.status.person == person
            and order.event == event
        )
        number = next(waiting, None)
        if number is None:  # It arrived at an earlier coordinator of this world.
            number = self.arrive(event, person, frame)
        reported = not norm and event.type in self._reported
        self._orders[number].accepted = frame
        self._change(number, "rejected" if norm else "accepted", frame, norm, is_open=reported)

    def report(self, frame: int, events: Iterable[AnyEvent]) -> list[OrderStatus]:
        """Note the reports among the events of a frame; returns the orders that they concern."""
        if not self._open:
            return []
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
        if not report.sender:  # What a person or a generator sends is no report of an agent.
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
