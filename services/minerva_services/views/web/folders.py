"""Folders of the page's panel: the selected agent, and the orders of people."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from viser import ClientHandle, GuiApi, GuiDropdownHandle, GuiEvent

from minerva_bus.grammar.scene import AgentNode
from minerva_services.views.fates import OrderEntry
from minerva_services.views.web import html
from minerva_services.views.web.forms import by_person

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
