"""Requests of the coordinator to a region, and the region's reports."""

from __future__ import annotations

from typing import Final

from minerva_bus.frame import messages as m
from minerva_bus.grammar.batch import AnyEvent

REPORTS_KEPT: Final = 2
"""Reports that the coordinator may request again: those of the frames that it may wait for."""


class RegionRequests:
    """Orders and frames that the coordinator has sent, and the reports that it may miss.

    `last` is the number of the last requested frame. `reports` are those of the last frames.
    """

    def __init__(self) -> None:
        self.last = -1
        self.reports: dict[int, m.TickReply] = {}
        self._orders: dict[int, tuple[AnyEvent, ...]] = {}

    def note(self, message: m.ToMember) -> None:
        """Note the orders of a frame, or the request to run it."""
        if isinstance(message, m.Orders):
            self._orders[message.frame] = message.events
        elif isinstance(message, m.TickRequest):
            self.last = message.frame

    @property
    def orders(self) -> list[m.Orders]:
        """The orders of frames that have not begun."""
        return [m.Orders(frame, events) for frame, events in sorted(self._orders.items())]

    def take_orders(self, frame: int) -> tuple[AnyEvent, ...]:
        """Remove and return the orders of a frame."""
        return self._orders.pop(frame, ())

    def keep(self, report: m.TickReply) -> None:
        """Keep the report of a frame, instead of an earlier one."""
        self.reports[report.frame] = report
        self.reports.pop(report.frame - REPORTS_KEPT, None)
