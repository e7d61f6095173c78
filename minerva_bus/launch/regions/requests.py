"""Requests of the coordinator to a region, and the region's reports."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Final

from minerva_bus.frame import messages as m
from minerva_bus.regions.journal import PROCESS
from minerva_bus.regions.part import PartSender

REPORTS_KEPT: Final = 2
"""Reports that the coordinator may request again, and as many as the region runs ahead: those of
the frames that it may wait for."""


class RegionRequests:
    """Frames that the coordinator has requested, and the reports that it may miss.

    `ahead` is the number of frames that the region may run ahead. `reports` are those of the last
    frames, which the `sender` encodes as changes since the one before, and `lines` of the world's
    log wait for the next one. `process` is the number that the coordinator has given this process.
    """

    def __init__(self, ahead: int) -> None:
        self.ahead = ahead
        self.process = 0
        self.reports: dict[int, m.TickReply] = {}
        self.sender = PartSender()
        self.lines: list[str] = []
        self._requests: dict[int, m.RegionRequest] = {}

    def note(self, request: m.RegionRequest) -> None:
        """Note the request to run a frame."""
        self._requests[request.frame] = request

    def take_lines(self) -> list[str]:
        """Remove and return the lines that wait for a report."""
        lines, self.lines = self.lines, []
        return lines

    @property
    def waiting(self) -> list[m.RegionRequest]:
        """The requests for frames that have not begun."""
        return [request for _, request in sorted(self._requests.items())]

    def of(self, frame: int) -> m.RegionRequest | None:
        """The request for a frame that has not begun; None if there is none."""
        return self._requests.get(frame)

    def take(self, frame: int) -> m.RegionRequest:
        """Remove and return the request for a frame."""
        return self._requests.pop(frame)

    def seen(self, member: str, request: m.RegionRequest) -> Iterator[m.TickReply]:
        """Take the last request: services have seen its views. The coordinator may wait for it."""
        self.take(request.frame)
        if request.views:
            yield self.keep(m.TickReply(member, request.frame, (), {}))

    def report(self, frame: int) -> m.TickReply | None:
        """The report of a frame, as one of this process; None if it is not kept."""
        report = self.reports.get(frame)
        return report and replace(report, saved={**(report.saved or {}), PROCESS: self.process})

    def keep(self, report: m.TickReply) -> m.TickReply:
        """Keep the report of a frame, instead of an earlier one; returns it as `report` does."""
        self.reports[report.frame] = report
        self.reports.pop(report.frame - REPORTS_KEPT - self.ahead, None)
        return self.report(report.frame) or report
