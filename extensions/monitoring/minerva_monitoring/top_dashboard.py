"""The live dashboard of a world, a textual application."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, Final, cast

from rich.text import Text
from textual import work
from textual.app import App, ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical
from textual.widgets import DataTable, Footer, RichLog, Sparkline, Static

from minerva_bus.errors import MinervaError
from minerva_bus.wording import duration
from minerva_bus.world.operator import CollectedSeries, LogEntry, LogLine, Operator, WorldStatus
from minerva_monitoring import top_texts
from minerva_monitoring.top_charts import SeriesCharts

REFRESH_SECONDS: Final = 0.25
HISTORY: Final = 120
"""Number of measured frame rates to show."""

COLUMNS = (
    "member",
    "state",
    "service",
    "types",
    "wait, µs per frame",
    "late",
    "last",
    "process",
    "figures",
)
RATES = (0.0, 1.0, 2.0, 5.0, 10.0, 20.0, 30.0, 60.0, 120.0, 250.0, 500.0, 1000.0)


class Dashboard(App[None]):
    """Members, phases, events and the log of one world; keys to operate it."""

    CSS = """
    #heading { height: 1; }
    #trouble { height: auto; display: none; color: $error; text-style: bold; }
    .panel { border: round $surface-lighten-2; border-title-color: $accent; padding: 0 1; }
    #members { height: auto; min-height: 4; max-height: 45%; }
    #middle { height: 2fr; min-height: 5; max-height: 15; }
    #phases, #events, #speed { width: 1fr; height: 100%; }
    #speed Sparkline { height: 1fr; margin-top: 1; }
    #log { height: 1fr; min-height: 4; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        ("space", "pause", "Pause"),
        ("s", "step", "Step"),
        ("plus,equals_sign", "faster", "Faster"),
        ("minus", "slower", "Slower"),
        ("r", "restart", "Restart"),
        ("e", "events", "Events"),
        ("q", "quit", "Quit"),
        # As it ends all commands; textual would only say which key quits.
        Binding("ctrl+c", "quit", show=False),
    ]
    ENABLE_COMMAND_PALETTE = False

    def __init__(self, operator: Operator) -> None:
        super().__init__()
        self._operator = operator
        self._status: WorldStatus | None = None
        self._event_number: int = 0
        self._line_number: int = 0
        self._events_too = False
        self._speeds: list[float] = []
        self._answered = time.monotonic()

    def compose(self) -> ComposeResult:
        """Create the widgets."""
        yield Static(id="heading")
        yield Static(id="trouble")
        yield DataTable[Text](id="members", classes="panel", cursor_type="row", zebra_stripes=True)
        with Horizontal(id="middle"):
            yield Static(id="phases", classes="panel")
            yield Static(id="events", classes="panel")
            with Vertical(id="speed", classes="panel"):
                yield Static(id="rate")
                yield Sparkline([], summary_function=max)
        yield SeriesCharts(id="series")
        yield RichLog(id="log", classes="panel", max_lines=2000)
        yield Footer()

    def on_mount(self) -> None:
        """Set titles, and refresh periodically."""
        members = self._members()
        for title in COLUMNS:
            members.add_column(title, key=title)
        titles = {
            "members": "members",
            "phases": "time per frame",
            "events": "events per second",
            "speed": "frames per second",
            "log": "log",
        }
        for name, title in titles.items():
            self.query_one(f"#{name}").border_title = title
        self.set_interval(REFRESH_SECONDS, self._poll_world)
        self._poll_world()

    # --- refreshing ---

    @work(thread=True, exclusive=True, group="refresh")
    def _poll_world(self) -> None:
        """Query the world in a thread, because an answer may take long."""
        try:
            status = self._operator.status(self._event_number)
            lines = self._operator.logs(self._line_number)
            series = self._operator.series() if status.series else ()
        except MinervaError as error:
            # Widgets may be used in the thread of the application only.
            self.call_from_thread(self._show_trouble, str(error))
            return
        self.call_from_thread(self._show, status, lines, series)

    def _is_gone(self) -> bool:
        """Whether the widgets are gone: an answer may arrive while the dashboard ends."""
        return not self.query("#trouble")

    def _show(
        self,
        status: WorldStatus,
        lines: Sequence[LogLine],
        series: Sequence[CollectedSeries] = (),
    ) -> None:
        if self._is_gone():
            return
        self._status, self._answered = status, time.monotonic()
        self._static("trouble").display = False
        self._static("heading").update(top_texts.heading(status))
        self._static("phases").update(top_texts.phases(status))
        self._static("events").update(top_texts.events(status.events))
        self._show_members(status)
        self._show_speed(status)
        self.query_one(SeriesCharts).show(series)
        self._show_log(status.happenings, lines)

    def _show_trouble(self, problem: str) -> None:
        if self._is_gone():
            return
        silent = time.monotonic() - self._answered
        trouble = self._static("trouble")
        trouble.update(f"no answer for {duration(silent)}: {problem}")
        trouble.display = True

    def _show_members(self, status: WorldStatus) -> None:
        table = self._members()
        longest = max((member.wait for member in status.members), default=0.0)
        there = {row.value for row in table.rows}
        for member in status.members:
            cells = top_texts.row(member, longest)
            if member.name not in there:
                table.add_row(*cells, key=member.name)
                continue
            # Cells are updated in place: filling the table again would move the cursor.
            for title, cell in zip(COLUMNS, cells, strict=True):
                table.update_cell(member.name, title, cell)
        for gone in there - {member.name for member in status.members}:
            table.remove_row(str(gone))

    def _show_speed(self, status: WorldStatus) -> None:
        self._speeds = [*self._speeds, status.hz][-HISTORY:]
        self.query_one("#speed Sparkline", Sparkline).data = self._speeds
        wanted = f"{status.rate:g} requested" if status.rate else "no limit"
        shown = Text.assemble((f"{status.hz:,.1f}", "bold"), f"   {wanted}")
        self._static("rate").update(shown)

    def _show_log(self, entries: tuple[LogEntry, ...], lines: Sequence[LogLine]) -> None:
        log = self.query_one(RichLog)
        for line in lines:
            clock = time.strftime("%H:%M:%S", time.localtime(line.time))
            log.write(Text.assemble((clock, "dim"), "  ", (line.member, "bold"), f"  {line.text}"))
            self._line_number = line.number
        for entry in entries:
            self._event_number = entry.number
            if self._events_too:
                frame = (f"{entry.frame:>8}", "dim")
                log.write(Text.assemble(frame, "  ", (entry.text, "magenta")))

    def _static(self, name: str) -> Static:
        return self.query_one(f"#{name}", Static)

    def _members(self) -> DataTable[Text]:
        return cast("DataTable[Text]", self.query_one("#members", DataTable))

    # --- keys ---

    def action_pause(self) -> None:
        """Pause or resume the world."""
        operator = self._operator
        paused = self._status is not None and self._status.paused
        self._operate(operator.resume if paused else operator.pause)

    def action_step(self) -> None:
        """Run one frame."""
        self._operate(self._operator.step)

    def action_faster(self) -> None:
        """Increase the frame rate."""
        wanted = self._status.rate if self._status is not None else 0.0
        # Without a limit (0) there is nothing faster.
        faster = [rate for rate in RATES if rate > wanted > 0]
        self._operate(self._operator.set_rate, faster[0] if faster else 0.0)

    def action_slower(self) -> None:
        """Decrease the frame rate."""
        if self._status is None:
            return
        # Without a limit, the first step down is below the measured rate.
        wanted = self._status.rate or self._status.hz
        slower = [rate for rate in RATES if 0 < rate < wanted]
        self._operate(self._operator.set_rate, slower[-1] if slower else RATES[1])

    def action_restart(self) -> None:
        """Restart the selected member."""
        table = self._members()
        if table.row_count:
            member = str(table.coordinate_to_cell_key(table.cursor_coordinate).row_key.value)
            self._operate(self._operator.restart, member)

    def action_events(self) -> None:
        """Show or hide events in the log."""
        self._events_too = not self._events_too
        self.query_one("#log").border_title = "log and events" if self._events_too else "log"

    @work(thread=True, group="send")
    def _operate(self, command: Callable[..., Any], *arguments: Any) -> None:
        try:
            command(*arguments)
        except MinervaError as error:
            self.call_from_thread(self.notify, str(error), severity="error")
            return
        self.call_from_thread(self._poll_world)
