"""Between the people at a page and their world: how it is doing, and what they want of it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from typing import Any, Protocol

from minerva_bus.errors import MinervaError
from minerva_bus.grammar.scene import AgentNode
from minerva_bus.world.services import WorldInfo
from minerva_services.views.web.diary import Diary
from minerva_services.views.web.orders import Orders, first_with
from minerva_services.views.web.panel import Panel
from minerva_services.views.web.picking import Clicked
from minerva_services.views.web.wording import parted

BEAT = 0.1
_STATUS_EVERY = 3
_STATE_EVERY = 10
_SOON = 1.5
"""Seconds in which a slider stays where a person has put it, whatever the agent's state says."""


class Scenery(Protocol):
    """What the desk needs to know and to mark in the world on the page."""

    def select(self, agent: str) -> None: ...
    def labels(self) -> tuple[str, ...]: ...


class Desk:
    """Asks the world in a thread of its own, and carries out what people do."""

    def __init__(self, world: WorldInfo, stage: Scenery, click: str) -> None:
        self._operator = world.operator
        self._vocabulary = world.vocabulary
        self._orders = Orders(world)
        self._stage = stage
        self._click = click
        self._panel: Panel | None = None
        self._diary = Diary()
        self._agents: dict[str, str] = {}
        self._selected = self._kind = ""
        self._chosen = self._silent = False
        self._types: tuple[str, ...] = ()
        self._offered: Any = None
        self._wanted: dict[str, Callable[[], str]] = {}
        self._lock = threading.Lock()
        self._moved_at = -_SOON
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._work, daemon=True)

    def open(self, panel: Panel) -> None:
        """Begin to ask the world and to fill the panel."""
        self._panel = panel
        self._thread.start()

    def close(self) -> None:
        """Ask no more."""
        self._over.set()
        if self._thread.is_alive():
            self._thread.join(BEAT)

    def meet(self, agents: dict[str, str]) -> None:
        """These agents, with their kinds, are there."""
        self._agents = agents

    # --- what people do ---

    def pause(self) -> None:
        self._do(self._operator.pause)

    def resume(self) -> None:
        self._do(self._operator.resume)

    def step(self) -> None:
        self._do(self._operator.step)

    def set_rate(self, rate: float) -> None:
        def act() -> str:
            self._operator.set_rate(rate)
            return f"{rate:g} frames a second wanted" if rate else "as many frames as go"

        self._soon("rate", act)

    def select(self, agent: str, kind: str = "") -> None:
        self._selected, self._kind = agent, kind or self._agents.get(agent, "")
        self._chosen = True
        self._stage.select(agent)
        self._offer()
        self._tell_agent()

    def order(self, event_type: str, data: Mapping[str, Any]) -> None:
        self._do(lambda: self._orders.send(event_type, data, self._selected, self._kind))

    def slide(self, event_type: str, data: Mapping[str, Any]) -> None:
        to, kind = self._selected, self._kind
        self._soon(event_type, lambda: self._orders.send(event_type, data, to, kind))

    def fragment(self) -> str:
        try:
            return self._operator.fragment(self._selected)
        except MinervaError as error:
            return str(error)

    def click(self, what: Clicked) -> None:
        """An agent is selected; a text is sent with the order type that takes one."""
        if what.agent:
            self.select(what.agent, self._agents.get(what.owner, ""))
        elif what.text:
            event_type = self._click or first_with(self._vocabulary, self._types, "text")
            if event_type:
                (name,) = self._vocabulary.events[event_type].fields.names
                self.order(event_type, {name: what.text})

    # --- what the world says ---

    def _work(self) -> None:
        beats = 0
        while not self._over.wait(BEAT):
            with self._complaining():
                self._send_wanted()
                if beats % _STATUS_EVERY == 0:
                    self._ask()
                if beats % _STATE_EVERY == 0:
                    self._tell_agent()
            beats += 1

    def _ask(self) -> None:
        silent, self._silent = self._silent, True
        status = self._operator.status(self._diary.last)
        self._silent = False
        if silent and self._panel is not None:
            self._panel.note("")  # It answers again.
        self._diary.hear(status)
        self._types = status.orders
        if self._panel is not None:
            self._panel.tell(status, rate=not self._just_moved())
            self._panel.tell_events(self._diary)
        self._select_the_only_one()
        self._offer()

    def _select_the_only_one(self) -> None:
        """Where just one agent takes orders, people mean that one."""
        listeners = self._listeners()
        if not self._chosen and len(listeners) == 1:
            self.select(listeners[0])

    def _listeners(self) -> list[str]:
        return [
            one
            for one, kind in self._agents.items()
            if not one.startswith("~")
            and any(self._orders.listens(kind, event_type) for event_type in self._types)
        ]

    def _offer(self) -> None:
        listeners = self._listeners()
        named = [one for one in self._agents if not one.startswith("~")]
        others = [one for one in named if one not in set(listeners)]
        offered = ((*listeners, *others), self._selected, self._types, self._stage.labels())
        with self._lock:
            if self._panel is None or offered == self._offered:
                return
            self._offered = offered
            self._panel.offer_agents(*offered[:2])
            self._panel.offer_orders(*offered[2:])

    def _tell_agent(self) -> None:
        """Show the selected agent's state; sliders show it too, or else the first listener's."""
        if self._panel is None:
            return
        agent: AgentNode | None = None
        name = self._selected or next(iter(self._listeners()), "")
        if name:
            with self._complaining():
                agent = parted(self._operator.fragment(name), self._vocabulary)
        with self._lock:
            self._panel.tell_agent(agent if self._selected else None)
            if agent is not None and not self._just_moved():
                self._panel.tell_sliders(agent.state)

    def _just_moved(self) -> bool:
        """Whether a person may still have a slider in hand."""
        return time.monotonic() - self._moved_at < _SOON

    # --- carrying out ---

    def _do(self, act: Callable[[], str | None]) -> None:
        with self._complaining():
            said = act()
            if self._panel is not None:
                self._panel.note(said or "")

    def _soon(self, what: str, act: Callable[[], str]) -> None:
        """Do it with the next beat; of what is wanted until then only the last."""
        self._moved_at = time.monotonic()
        with self._lock:
            self._wanted[what] = act

    def _send_wanted(self) -> None:
        with self._lock:
            wanted, self._wanted = self._wanted, {}
        for act in wanted.values():
            self._do(act)

    @contextmanager
    def _complaining(self) -> Generator[None]:
        """What the world refuses, and its silence, is a line on the page."""
        try:
            yield
        except MinervaError as error:
            if self._panel is not None and not self._over.is_set():
                self._panel.complain(str(error))
