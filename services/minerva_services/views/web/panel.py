"""The panel of the page: status, the selected agent, orders of people, forms and charts.

A form for an order type is derived from its declared data.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import chain
from typing import Any, Final, Protocol

import numpy as np
from viser import (
    ClientHandle,
    GuiApi,
    GuiDropdownHandle,
    GuiEvent,
    GuiSliderHandle,
    GuiUplotHandle,
    ViserServer,
    uplot,
)

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.fields import Field
from minerva_bus.grammar.scene import AgentNode
from minerva_bus.grammar.text_and_digest import value_text
from minerva_bus.grammar.vocabulary import EventType, Vocabulary
from minerva_bus.world.operator import CollectedSeries, LogEntry, Operator, WorldStatus
from minerva_services.geometry.colors import OKABE_ITO, Legend
from minerva_services.views.fates import OrderEntry
from minerva_services.views.reports import LatestReport
from minerva_services.views.web import html

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


EVERYBODY: str = "all"
_MAX_AGENTS = 200


class AgentFolder:
    """The selected agent and its state.

    `select` is called with the agent that a user selects, "" for all. `fragment` returns the
    string of the selected agent.
    """

    def __init__(
        self, gui: GuiApi, select: Callable[[str], None], fragment: Callable[[], str]
    ) -> None:
        with gui.add_folder("Agent"):
            self._selected: GuiDropdownHandle[str] = gui.add_dropdown(
                "selected", (EVERYBODY,), hint="receiver of orders; a click on an agent selects it"
            )
            self._state = gui.add_html("")
            self._full = gui.add_button("Full text", visible=False)

        @self._selected.on_update
        def _(event: GuiEvent[Any]) -> None:
            # `offer` sets the value as well, which is not a selection by a user.
            if by_person(event):
                chosen = self._selected.value
                select("" if chosen == EVERYBODY else chosen)

        @self._full.on_click
        def _(event: GuiEvent[Any]) -> None:
            if event.client is not None:
                _show_whole(event.client, fragment())

    def offer(self, agents: tuple[str, ...], selected: str) -> None:
        """Offer these agents for selection."""
        options = (EVERYBODY, *agents[:_MAX_AGENTS])
        if selected and selected not in options:
            options = (*options, selected)
        if options != self._selected.options:
            self._selected.options = options
        self._selected.value = selected or EVERYBODY

    def show(self, agent: AgentNode | None) -> None:
        """Show an agent's state."""
        self._state.content = html.state(agent)
        self._full.visible = agent is not None


def _show_whole(client: ClientHandle, text: str) -> None:
    with client.gui.add_modal("The agent's string") as modal:
        client.gui.add_html(html.whole(text))
        client.gui.add_button("Close").on_click(lambda _: modal.close())


class FatesFolder:
    """The last orders of people with their fates; visible once there are any."""

    def __init__(self, gui: GuiApi) -> None:
        with gui.add_folder("Orders of people", visible=False) as self._folder:
            self._text = gui.add_html("")

    def show(self, orders: Sequence[OrderEntry]) -> None:
        """Show these orders."""
        self._folder.visible = bool(orders)
        self._text.content = html.fates(orders)


_RANGES = {
    "m/s": (0.0, 2.0, 0.05),
    "m": (0.0, 10.0, 0.1),
    "deg": (-180.0, 180.0, 1.0),
    "s": (0.0, 60.0, 0.5),
}
"""Minimum, maximum and step of a slider by unit."""

Send = Callable[[str, Mapping[str, Any]], None]


def by_person(event: GuiEvent[Any]) -> bool:
    """True if a user changed an input, rather than this program."""
    return event.client_id is not None


class Form:
    """Inputs for the data of one event type; a single real with a known range is a slider.

    `send` is called when the button is pressed, `slide` whenever the slider moves.
    """

    def __init__(
        self, gui: GuiApi, declared: EventType, labels: tuple[str, ...], send: Send, slide: Send
    ) -> None:
        self._gui = gui
        self._type = declared.name
        self._labels = labels
        self._send = send
        self._slide = slide
        self._slider: GuiSliderHandle[float] | None = None
        self._inputs: dict[str, Any] = {}
        self._lock = threading.Lock()
        fields = declared.fields.all
        # A slider sends while it moves, so it needs no button.
        if kinds_of_data(declared) == ("real",) and fields[0].type.unit in _RANGES:
            self._add_slider(fields[0])
            return
        for field in fields:
            self._inputs[field.name] = self._input(field)
        self._button = gui.add_button(f"Send {declared.name}")
        self._button.on_click(lambda _: send(declared.name, self.data()))

    def data(self) -> dict[str, Any]:
        """The values entered."""
        return {name: widget.value for name, widget in self._inputs.items()}

    def outgrown(self, labels: tuple[str, ...]) -> bool:
        """True if its text inputs could now be selections of labels."""
        return bool(labels) and not self._labels

    def offer(self, labels: tuple[str, ...]) -> None:
        """Offer these labels for text inputs."""
        if labels == self._labels or not labels:
            return
        self._labels = labels
        for widget in self._inputs.values():
            if isinstance(widget, GuiDropdownHandle):
                widget.options = labels

    def update(self, state: Mapping[str, Any]) -> None:
        """Move the slider to the value in the agent's state."""
        if self._slider is None:
            return
        (name,) = self._inputs
        value = state.get(name)
        if isinstance(value, float):
            # The range first, because the value must lie within it.
            self._slider.max = max(self._slider.max, value)
            self._slider.min = min(self._slider.min, value)
            self._slider.value = value

    def remove(self) -> None:
        """Remove the form from the page."""
        for widget in self._inputs.values():
            widget.remove()
        if self._slider is None:
            self._button.remove()

    def _input(self, field: Field) -> Any:
        gui, name, kind, given = self._gui, title(field), field.type.kind, field.default
        if kind == "bool":
            return gui.add_checkbox(name, bool(given))
        if kind == "text" and self._labels:
            # Inputs start with different labels, because an order with the same label as source and
            # target makes no sense.
            next_one = self._labels[len(self._inputs) % len(self._labels)]
            known = str(given) if given in self._labels else next_one
            return gui.add_dropdown(name, self._labels, initial_value=known)
        if kind == "text":
            return gui.add_text(name, given if isinstance(given, str) else "")
        number = given if isinstance(given, int | float) else 0
        if kind == "int":
            return gui.add_number(name, int(number), step=1)
        return gui.add_number(name, float(number), step=0.01)

    def _add_slider(self, field: Field) -> None:
        least, most, step = _RANGES[field.type.unit]
        value = field.default if isinstance(field.default, float) else max(least, 0.0)
        self._slider = self._gui.add_slider(
            title(field), min(least, value), max(most, value), step, value
        )
        self._inputs[field.name] = self._slider

        @self._slider.on_update
        def _(event: GuiEvent[Any]) -> None:
            if by_person(event):
                self._slide(self._type, self.data())


_HEIGHT: Final = 140
_PADDING: Final = (14, 12, 0, 0)
"""Top, right, bottom and left, pixels: the greatest label of an axis is not cut off."""


class ChartFolder:
    """A small chart for each series, in a folder that is visible once there is one."""

    def __init__(self, gui: GuiApi) -> None:
        self._gui = gui
        self._folder = gui.add_folder("Collected", visible=False)
        self._charts: dict[str, GuiUplotHandle] = {}
        self._shown: tuple[CollectedSeries, ...] = ()

    def show(self, series: Sequence[CollectedSeries]) -> None:
        """Show series over the frames."""
        shown = tuple([each for each in series if each.frames])
        # Each change is sent to all browsers.
        if shown == self._shown:
            return
        self._shown = shown
        self._folder.visible = bool(shown)
        for gone in self._charts.keys() - {each.name for each in shown}:
            self._charts.pop(gone).remove()
        for number, each in enumerate(shown):
            data = np.array(each.frames, float), np.array(each.values, float)
            if each.name in self._charts:
                self._charts[each.name].data = data
            else:
                self._charts[each.name] = self._add(each, data, OKABE_ITO[number % len(OKABE_ITO)])

    def _add(
        self, series: CollectedSeries, data: tuple[np.ndarray, ...], color: str
    ) -> GuiUplotHandle:
        name = f"{series.name}, {series.unit}" if series.unit else series.name
        with self._folder:
            return self._gui.add_uplot(
                data,
                (
                    uplot.Series(label="frame"),
                    uplot.Series(label=name, stroke=color, width=2, spanGaps=False),
                ),
                title=name,
                scales={"x": uplot.Scale(time=False)},
                legend=uplot.Legend(show=False),
                height=_HEIGHT,
                padding=_PADDING,
            )


_INPUT_KINDS = ("text", "real", "int", "bool")


def kinds_of_data(declared: EventType) -> tuple[str, ...]:
    """The kinds of an event type's data, such as ("text", "text")."""
    return tuple(field.type.kind for field in declared.fields.all)


def can_be_asked(declared: EventType) -> bool:
    """True if a form has inputs for all data of an event type."""
    return all(kind in _INPUT_KINDS for kind in kinds_of_data(declared))


def first_with(vocabulary: Vocabulary, types: tuple[str, ...], kind: str) -> str:
    """The first of the event types whose only datum is of this kind; "" for none."""
    known = (name for name in types if name in vocabulary.events)
    return next((name for name in known if kinds_of_data(vocabulary.events[name]) == (kind,)), "")


def title(field: Field) -> str:
    """A field's name with its unit."""
    return f"{field.name} ({field.type.unit})" if field.type.unit else field.name


class OrderSender:
    """Sends orders of a person to one agent or to all subscribers."""

    def __init__(self, vocabulary: Vocabulary, operator: Operator) -> None:
        self.vocabulary = vocabulary
        self._operator = operator

    def send(self, event_type: str, data: Mapping[str, Any], agent: str, kind: str) -> str:
        """Send an order to an agent of a kind, or with "" to all; returns a confirmation line.

        Raises MisuseError if the agent does not subscribe to it, and errors of the operator.
        """
        if agent and not self.accepts(kind, event_type):
            raise MisuseError(f"{agent} does not accept {event_type}; select another agent, or all")
        declared = self.vocabulary.events[event_type]
        self._operator.order(declared(**data, receivers=[agent] if agent else []))
        shown = ", ".join(f"{name}={_short(value)}" for name, value in data.items())
        return f"{event_type}({shown}) sent to {agent or 'all'}"

    def accepts(self, kind: str, event_type: str) -> bool:
        """True if agents of a kind subscribe to an event type."""
        known = self.vocabulary.kinds.get(kind)
        return known is not None and event_type in known.subscribes


def _short(value: Any) -> str:
    return value if isinstance(value, str) else value_text(value)
