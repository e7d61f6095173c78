"""Controller of a page: shows the world's status and performs the users' actions."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Protocol

from minerva_bus.errors import MinervaError
from minerva_bus.grammar.scene import AgentNode
from minerva_bus.world.services import WorldInfo
from minerva_services.views.fates import LatestOrders
from minerva_services.views.web.html import parted
from minerva_services.views.web.panel import EventFeed, OrderSender, Panel, first_with
from minerva_services.views.web.picking import Clicked

POLL_SECONDS = 0.1
# Polls between two queries of the status, and between two of the selected agent's state.
_STATUS_POLLS = 3
_STATE_POLLS = 10
_MAX_ORDERS = 8
"""Orders that the panel lists."""

_SLIDER_SECONDS = 1.5
"""Seconds for which a slider stays where a user has put it, whatever the agent's state says."""


class Scenery(Protocol):
    """What the controller needs to read from and mark in the scene."""

    def select(self, agent: str) -> None: ...
    def labels(self) -> tuple[str, ...]: ...


@dataclass(slots=True)
class _Selection:
    """The selected agent with its kind, and whether anything was selected explicitly."""

    agent: str = ""
    kind: str = ""
    is_explicit: bool = False


@dataclass(slots=True)
class _Receivers:
    """The displayed agents with their kinds, and the order types that the world accepts."""

    agents: dict[str, str] = field(default_factory=dict[str, str])
    types: tuple[str, ...] = ()

    def listeners(self, accepts: Callable[[str, str], bool]) -> list[str]:
        """The agents that accept an order; `accepts` is called with a kind and an order type."""
        return [
            agent
            for agent in self.named
            if any(accepts(self.agents[agent], event_type) for event_type in self.types)
        ]

    @property
    def named(self) -> list[str]:
        """The agents with ids of their own: "~" begins those of parts of a view."""
        return [agent for agent in self.agents if not agent.startswith("~")]


class _LatestActions:
    """Queued actions, of which only the latest of each kind is performed."""

    def __init__(self) -> None:
        self._actions: dict[str, Callable[[], str]] = {}
        self._put_at = -_SLIDER_SECONDS
        self._lock = threading.Lock()

    def put(self, what: str, act: Callable[[], str]) -> None:
        """Queue an action, replacing an earlier one of the same kind."""
        self._put_at = time.monotonic()
        with self._lock:
            # A moving slider queues many values, of which only the last matters.
            self._actions[what] = act

    def take(self) -> list[Callable[[], str]]:
        """Remove and return the queued actions."""
        with self._lock:
            actions, self._actions = self._actions, {}
        return list(actions.values())

    @property
    def recent(self) -> bool:
        """True while a user may still be moving a slider."""
        return time.monotonic() - self._put_at < _SLIDER_SECONDS


class PageController:
    """Polls the world in its own thread, and performs the users' actions."""

    def __init__(self, world: WorldInfo, scene: Scenery, click: str, person: str = "") -> None:
        self._operator = world.operator.named(person)
        self._orders = OrderSender(world.vocabulary, self._operator)
        self._fates = LatestOrders(_MAX_ORDERS)
        self._scene = scene
        self._click = click
        self._panel: Panel | None = None
        self._feed = EventFeed(world.vocabulary)
        self._receivers = _Receivers()
        self._selection = _Selection()
        self._silent = False
        self._offered: Any = None
        self._queue = _LatestActions()
        # Clicks arrive in viser's threads, polling has its own.
        self._lock = threading.Lock()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._work, daemon=True)

    def open(self, panel: Panel) -> None:
        """Start polling the world and updating the panel."""
        self._panel = panel
        self._thread.start()

    def close(self) -> None:
        """Stop polling."""
        self._over.set()
        if self._thread.is_alive():
            self._thread.join(POLL_SECONDS)

    def set_agents(self, agents: dict[str, str]) -> None:
        """Set the displayed agents with their kinds."""
        self._receivers.agents = agents

    # --- user actions ---

    def pause(self) -> None:
        self._do(self._operator.pause)

    def resume(self) -> None:
        self._do(self._operator.resume)

    def step(self) -> None:
        self._do(self._operator.step)

    def set_rate(self, rate: float) -> None:
        def act() -> str:
            self._operator.set_rate(rate)
            return f"target rate {rate:g} frames per second" if rate else "maximum frame rate"

        self._queue.put("rate", act)

    def select(self, agent: str, kind: str = "") -> None:
        self._selection = _Selection(agent, kind or self._receivers.agents.get(agent, ""), True)
        self._scene.select(agent)
        self._offer()
        self._show_agent()

    def order(self, event_type: str, data: Mapping[str, Any]) -> None:
        self._do(self._sender(event_type, data))

    def slide(self, event_type: str, data: Mapping[str, Any]) -> None:
        self._queue.put(event_type, self._sender(event_type, data))

    def fragment(self) -> str:
        try:
            return self._operator.fragment(self._selection.agent)
        except MinervaError as error:
            return str(error)

    def click(self, what: Clicked) -> None:
        """Select an agent, or send a text with the order type that accepts one."""
        if what.agent:
            self.select(what.agent, self._receivers.agents.get(what.owner, ""))
        elif what.text:
            vocabulary = self._orders.vocabulary
            event_type = self._click or first_with(vocabulary, self._receivers.types, "text")
            if event_type:
                (name,) = vocabulary.events[event_type].fields.names
                self.order(event_type, {name: what.text})

    # --- polling, in the controller's thread ---

    def _work(self) -> None:
        beats = 0
        while not self._over.wait(POLL_SECONDS):
            with self._reporting():
                for act in self._queue.take():
                    self._do(act)
                if beats % _STATUS_POLLS == 0:
                    self._poll()
                if beats % _STATE_POLLS == 0:
                    self._show_agent()
            beats += 1

    def _poll(self) -> None:
        # Stays set if the query fails.
        silent, self._silent = self._silent, True
        status = self._operator.status(self._feed.last)
        self._silent = False
        if silent and self._panel is not None:
            self._panel.note("")  # the world answers again
        self._feed.update(status)
        self._receivers.types = status.orders
        if self._panel is not None:
            self._panel.show_status(status, self._feed.report, rate=not self._queue.recent)
            self._panel.show_events(self._feed)
            if self._fates.update(self._operator):
                self._panel.show_fates(self._fates.entries)
            if status.series:
                self._panel.show_series(self._operator.series())
        self._select_the_only_one()
        self._offer()

    def _select_the_only_one(self) -> None:
        """If exactly one agent accepts orders, select it by default."""
        listeners = self._listeners()
        if not self._selection.is_explicit and len(listeners) == 1:
            self.select(listeners[0])

    def _listeners(self) -> list[str]:
        return self._receivers.listeners(self._orders.accepts)

    def _offer(self) -> None:
        listeners = self._listeners()
        others = [agent for agent in self._receivers.named if agent not in set(listeners)]
        agents = (*listeners, *others)
        offered = agents, self._selection.agent, self._receivers.types, self._scene.labels()
        with self._lock:
            # Each change of an input is sent to all browsers.
            if self._panel is None or offered == self._offered:
                return
            self._offered = offered
            self._panel.offer_agents(*offered[:2])
            self._panel.offer_orders(*offered[2:])

    def _show_agent(self) -> None:
        """Show the selected agent's state; sliders show it, or else the first listener's."""
        if self._panel is None:
            return
        agent: AgentNode | None = None
        name = self._selection.agent or next(iter(self._listeners()), "")
        if name:
            with self._reporting():
                agent = parted(self._operator.fragment(name), self._orders.vocabulary)
        with self._lock:
            self._panel.show_agent(agent if self._selection.agent else None)
            if agent is not None and not self._queue.recent:
                self._panel.show_sliders(agent.state)

    # --- performing actions ---

    def _sender(self, event_type: str, data: Mapping[str, Any]) -> Callable[[], str]:
        to = self._selection
        return lambda: self._orders.send(event_type, data, to.agent, to.kind)

    def _do(self, act: Callable[[], str | None]) -> None:
        with self._reporting():
            line = act()
            if self._panel is not None:
                self._panel.note(line or "")

    @contextmanager
    def _reporting(self) -> Generator[None]:
        """Show errors of the world, and time-outs, on the page."""
        try:
            yield
        except MinervaError as error:
            if self._panel is not None and not self._over.is_set():
                self._panel.show_error(str(error))
