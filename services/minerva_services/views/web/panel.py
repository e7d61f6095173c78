"""The page's panel: status of the world, and controls."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from itertools import chain
from typing import Any, Protocol

from viser import GuiDropdownHandle, GuiEvent, ViserServer

from minerva_bus.grammar.scene import AgentNode
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.semantics.colors import Legend
from minerva_bus.world.operator import CollectedSeries, LogEntry, WorldStatus
from minerva_services.views.fates import OrderEntry
from minerva_services.views.reports import LatestReport
from minerva_services.views.web import html
from minerva_services.views.web.folders import AgentFolder, FatesFolder
from minerva_services.views.web.forms import Form, by_person
from minerva_services.views.web.orders import can_be_asked
from minerva_services.views.web.series import ChartFolder

NOTABLE: str = "rare events"
ALL: str = "all"
_MAX_PER_TYPE = 30
_FREQUENT = 0.3
"""Mean number of events of a type per frame from which they are not rare."""


class EventFeed:
    """The latest events of each type, and the latest report of an agent."""

    def __init__(self, vocabulary: Vocabulary) -> None:
        self._reports = LatestReport(vocabulary)
        self._kept: dict[str, deque[LogEntry]] = {}
        self._often: set[str] = set()

    def update(self, status: WorldStatus) -> None:
        """Add the events since the last update."""
        frames = max(status.hz, 1.0)
        # A frequent type stays in the set, so that the list does not change back and forth.
        self._often |= {name for name, rate in status.events.items() if rate > _FREQUENT * frames}
        for event in status.happenings:
            self._kept.setdefault(event.about, deque(maxlen=_MAX_PER_TYPE)).append(event)
        self._reports.update(status)

    @property
    def last(self) -> int:
        """Number of the latest log entry, from which to ask for further ones."""
        return self._reports.last

    @property
    def report(self) -> str:
        """The latest report of an agent."""
        return self._reports.text

    @property
    def choices(self) -> tuple[str, ...]:
        """Options of the filter."""
        return (NOTABLE, ALL, *sorted(self._kept))

    def chosen(self, choice: str, most: int) -> list[LogEntry]:
        """The latest events of a filter option, oldest first."""
        if choice == NOTABLE:
            groups: Iterable[deque[LogEntry]] = (
                kept for about, kept in self._kept.items() if about not in self._often
            )
        else:
            groups = (kept for about, kept in self._kept.items() if choice in (ALL, about))
        return sorted(chain.from_iterable(groups), key=lambda event: event.number)[-most:]


_MAX_SHOWN = 14
_MAX_RATE = 120.0
_ENDED = "The page shows the last state. A new run at this address appears automatically."


class PanelActions(Protocol):
    """Actions that the panel triggers."""

    def pause(self) -> None: ...
    def resume(self) -> None: ...
    def step(self) -> None: ...
    def set_rate(self, rate: float) -> None: ...
    def select(self, agent: str) -> None: ...
    def order(self, event_type: str, data: Mapping[str, Any]) -> None: ...
    def slide(self, event_type: str, data: Mapping[str, Any]) -> None: ...
    def fragment(self) -> str: ...


class Panel:
    """All inputs and texts next to the scene."""

    def __init__(
        self, server: ViserServer, world: str, vocabulary: Vocabulary, actions: PanelActions
    ) -> None:
        self._gui = gui = server.gui
        self._vocabulary = vocabulary
        self._actions = actions
        self._forms: dict[str, Form] = {}
        gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(47, 111, 143))
        gui.set_panel_label(world)
        gui.main_panel.dock_right()
        self._head = gui.add_html("")
        self._notice = gui.add_html("")
        self._add_pace()
        with gui.add_folder("Legend"):
            self._legend = gui.add_html(html.legend(()))
        self._agent = AgentFolder(gui, actions.select, actions.fragment)
        self._orders = gui.add_folder("Orders", visible=False)
        self._fates = FatesFolder(gui)
        # Above the events, of which there may be many.
        self._series = ChartFolder(gui)
        with gui.add_folder("Events"):
            self._filter: GuiDropdownHandle[str] = gui.add_dropdown("show", (NOTABLE,))
            self._events = gui.add_html("")

    @property
    def filter(self) -> str:
        """The selected event filter."""
        return self._filter.value

    def show_legend(self, legend: Legend) -> None:
        """Show what the colours of the scene mean."""
        content = html.legend(legend)
        if content != self._legend.content:
            self._legend.content = content

    def show_status(self, status: WorldStatus, report: str = "", *, rate: bool) -> None:
        """Show the status and the latest report, and with `rate` the target rate on its slider."""
        self._head.content = html.head(status, report)
        self._rate.max = max(self._rate.max, status.rate)
        if rate:
            self._rate.value = status.rate

    def note(self, text: str) -> None:
        """Show a line about the last action."""
        self._notice.content = html.notice(text)

    def show_error(self, text: str) -> None:
        """Show an error."""
        self._notice.content = html.problem(text)

    def show_events(self, feed: EventFeed) -> None:
        """Show the selected events."""
        if feed.choices != self._filter.options:
            self._filter.options = feed.choices
        self._events.content = html.events(feed.chosen(self.filter, _MAX_SHOWN))

    def show_fates(self, orders: Sequence[OrderEntry]) -> None:
        """Show the last orders of people with their fates."""
        self._fates.show(orders)

    def show_series(self, series: Sequence[CollectedSeries]) -> None:
        """Show the collected series."""
        self._series.show(series)

    def show_agent(self, agent: AgentNode | None) -> None:
        """Show an agent's state."""
        self._agent.show(agent)

    def show_sliders(self, state: Mapping[str, Any]) -> None:
        """Move sliders to the values in an agent's state."""
        for form in tuple(self._forms.values()):
            form.update(state)

    def offer_agents(self, agents: tuple[str, ...], selected: str) -> None:
        """Offer these agents for selection."""
        self._agent.offer(agents, selected)

    def offer_orders(self, types: tuple[str, ...], labels: tuple[str, ...]) -> None:
        """Show a form for each of these event types."""
        known = self._vocabulary.events
        wanted = [name for name in types if name in known and can_be_asked(known[name])]
        wanted.sort(key=lambda name: len(known[name].fields.all))
        for name, form in tuple(self._forms.items()):
            # A text input cannot become a selection of labels, so its form is built again.
            if name not in wanted or form.outgrown(labels):
                self._forms.pop(name).remove()
        for name in wanted:
            if name in self._forms:
                self._forms[name].offer(labels)
            else:
                with self._orders:
                    self._forms[name] = Form(
                        self._gui, known[name], labels, self._actions.order, self._actions.slide
                    )
        self._orders.visible = bool(self._forms)

    def end(self, text: str) -> None:
        """Show that the connection has ended, and why."""
        self._head.content = html.problem(text)
        self._notice.content = ""
        with self._gui.add_modal(text[:1].upper() + text[1:]):
            self._gui.add_html(html.notice(_ENDED))

    def _add_pace(self) -> None:
        gui, actions = self._gui, self._actions
        buttons = gui.add_button_group("", ("Pause", "Resume", "Step"))
        acts = {"Pause": actions.pause, "Resume": actions.resume, "Step": actions.step}
        buttons.on_click(lambda _: acts[buttons.value]())
        self._rate = gui.add_slider(
            "frames/s", 0.0, _MAX_RATE, 1.0, 0.0, hint="frames per second; 0: unlimited"
        )

        @self._rate.on_update
        def _(event: GuiEvent[Any]) -> None:
            # `show_status` moves the slider as well, which is not an action of a user.
            if by_person(event):
                actions.set_rate(self._rate.value)
