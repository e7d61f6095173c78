"""Requests of the coordinator to a region, and the region's reports."""

from __future__ import annotations

from typing import Final

from minerva_bus.frame import messages as m

REPORTS_KEPT: Final = 2
"""Reports that the coordinator may request again: those of the frames that it may wait for."""


class RegionRequests:
    """Events and frames that the coordinator has sent, and the reports that it may miss.

    `last` is the number of the last requested frame. `reports` are those of the last frames.
    """

    def __init__(self) -> None:
        self.last = -1
        self.reports: dict[int, m.TickReply] = {}
        self._outside: dict[int, m.RegionInputs] = {}

    def note(self, message: m.ToMember) -> None:
        """Note the outside events of a frame, or the request to run it."""
        if isinstance(message, m.RegionInputs):
            self._outside[message.frame] = message
        elif isinstance(message, m.TickRequest):
            self.last = message.frame

    @property
    def outside(self) -> list[m.RegionInputs]:
        """The outside events of frames that have not begun."""
        return [events for _, events in sorted(self._outside.items())]

    def take(self, frame: int) -> m.RegionInputs:
        """Remove and return the outside events of a frame."""
        return self._outside.pop(frame, m.RegionInputs(frame, {}))

    def keep(self, report: m.TickReply) -> None:
        """Keep the report of a frame, instead of an earlier one."""
        self.reports[report.frame] = report
        self.reports.pop(report.frame - REPORTS_KEPT, None)
