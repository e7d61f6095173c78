"""The page's panel: how the world is doing, and all that a person may do about it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

from viser import ClientHandle, GuiDropdownHandle, GuiEvent, ViserServer

from minerva_bus.grammar.scene import AgentNode
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.world.operator import WorldStatus
from minerva_services.views.web import wording
from minerva_services.views.web.diary import NOTABLE, Diary
from minerva_services.views.web.forms import Form, by_person
from minerva_services.views.web.orders import can_be_asked

EVERYBODY: str = "all"
_EVENTS = 14
_FASTEST = 120.0
_MOST_AGENTS = 200
_AFTERWARDS = "What you see is how it was last. A new run at this address appears by itself."


class Hands(Protocol):
    """What the panel does when a person uses it."""

    def pause(self) -> None: ...
    def resume(self) -> None: ...
    def step(self) -> None: ...
    def set_rate(self, rate: float) -> None: ...
    def select(self, agent: str) -> None: ...
    def order(self, event_type: str, data: Mapping[str, Any]) -> None: ...
    def slide(self, event_type: str, data: Mapping[str, Any]) -> None: ...
    def fragment(self) -> str: ...


class Panel:
    """All inputs and texts beside the world."""

    def __init__(
        self, server: ViserServer, world: str, vocabulary: Vocabulary, hands: Hands
    ) -> None:
        self._gui = gui = server.gui
        self._vocabulary = vocabulary
        self._hands = hands
        self._forms: dict[str, Form] = {}
        gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(47, 111, 143))
        gui.set_panel_label(world)
        gui.main_panel.dock_right()
        self._head = gui.add_html("")
        self._notice = gui.add_html("")
        self._add_pace()
        self._add_agent()
        self._orders = gui.add_folder("Orders", visible=False)
        with gui.add_folder("Events"):
            self._filter: GuiDropdownHandle[str] = gui.add_dropdown("show", (NOTABLE,))
            self._events = gui.add_html("")

    @property
    def filter(self) -> str:
        """Which events people want to see."""
        return self._filter.value

    def tell(self, status: WorldStatus, *, rate: bool) -> None:
        """Show how the world is doing, and with `rate` the wanted rate on its slider."""
        self._head.content = wording.head(status)
        self._rate.max = max(self._rate.max, status.rate)
        if rate:
            self._rate.value = status.rate

    def note(self, text: str) -> None:
        """Show a line of what was done."""
        self._notice.content = wording.notice(text)

    def complain(self, text: str) -> None:
        """Show a line of what went wrong."""
        self._notice.content = wording.problem(text)

    def tell_events(self, diary: Diary) -> None:
        """Show the chosen events."""
        if diary.choices != self._filter.options:
            self._filter.options = diary.choices
        self._events.content = wording.events(diary.chosen(self.filter, _EVENTS))

    def tell_agent(self, agent: AgentNode | None) -> None:
        """Show an agent's state."""
        self._state.content = wording.state(agent)
        self._full.visible = agent is not None

    def tell_sliders(self, state: Mapping[str, Any]) -> None:
        """Let sliders stand where an agent's state has what they are about."""
        for form in tuple(self._forms.values()):
            form.tell(state)

    def offer_agents(self, agents: tuple[str, ...], selected: str) -> None:
        """Let these be chosen from."""
        options = (EVERYBODY, *agents[:_MOST_AGENTS])
        if selected and selected not in options:
            options = (*options, selected)
        if options != self._agent.options:
            self._agent.options = options
        self._agent.value = selected or EVERYBODY

    def offer_orders(self, types: tuple[str, ...], labels: tuple[str, ...]) -> None:
        """Have a form for each of these event types."""
        known = self._vocabulary.events
        wanted = [one for one in types if one in known and can_be_asked(known[one])]
        wanted.sort(key=lambda one: len(known[one].fields.all))
        for name, form in tuple(self._forms.items()):
            if name not in wanted or form.outgrown(labels):
                self._forms.pop(name).remove()
        for one in wanted:
            if one in self._forms:
                self._forms[one].offer(labels)
            else:
                with self._orders:
                    self._forms[one] = Form(
                        self._gui, known[one], labels, self._hands.order, self._hands.slide
                    )
        self._orders.visible = bool(self._forms)

    def end(self, text: str) -> None:
        """Say why nothing will come any more."""
        self._head.content = wording.problem(text)
        self._notice.content = ""
        with self._gui.add_modal(text[:1].upper() + text[1:]):
            self._gui.add_html(wording.notice(_AFTERWARDS))

    def _add_pace(self) -> None:
        gui, hands = self._gui, self._hands
        buttons = gui.add_button_group("", ("Pause", "Resume", "Step"))
        acts = {"Pause": hands.pause, "Resume": hands.resume, "Step": hands.step}
        buttons.on_click(lambda _: acts[buttons.value]())
        self._rate = gui.add_slider(
            "frames/s", 0.0, _FASTEST, 1.0, 0.0, hint="frames a second; 0: as many as go"
        )

        @self._rate.on_update
        def _(event: GuiEvent[Any]) -> None:
            if by_person(event):
                hands.set_rate(self._rate.value)

    def _add_agent(self) -> None:
        gui, hands = self._gui, self._hands
        with gui.add_folder("Agent"):
            self._agent: GuiDropdownHandle[str] = gui.add_dropdown(
                "selected", (EVERYBODY,), hint="orders go to the selected agent; or click on one"
            )
            self._state = gui.add_html("")
            self._full = gui.add_button("Whole text", visible=False)

        @self._agent.on_update
        def _(event: GuiEvent[Any]) -> None:
            if by_person(event):
                chosen = self._agent.value
                hands.select("" if chosen == EVERYBODY else chosen)

        @self._full.on_click
        def _(event: GuiEvent[Any]) -> None:
            if event.client is not None:
                _show_whole(event.client, hands.fragment())


def _show_whole(client: ClientHandle, text: str) -> None:
    with client.gui.add_modal("The agent's string") as modal:
        client.gui.add_html(wording.whole(text))
        client.gui.add_button("Close").on_click(lambda _: modal.close())
