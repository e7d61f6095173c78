"""The simulated network of one world: a hub, its clients, and the links between them."""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import Any, Final

from minerva_bus.wire.codec import declaration, stamp
from tests.simulator.links import Link, Weather
from tests.simulator.process import SimulatedProcess
from tests.simulator.sessions import Query, Session, matches
from tests.simulator.timeline import EPOCH, Timeline
from tests.simulator.tokens import Tokens

LEASE: Final = 3.0
"""Seconds of silence after which a link is closed, as in `runtime/session.py`."""

RETRY: Final = 0.02, 0.5
RESET: Final = 1e-4, 20e-3
"""Seconds until a side detects that the other one has closed a link."""

TOKENS_FIRST: Final = 0.2
"""Probability that a new link announces tokens before subscribers."""

ECHO: Final = 1e-4, 2e-2
"""Seconds until a repeated reply arrives for the second time."""

_STAMP: Final = len(stamp(int(EPOCH)))
LOST: Final = 0.5
"""Share of droppable messages that are lost while views are being dropped."""


class Network:
    """Carries messages of sessions. `graveyard` keeps the coroutines of killed processes."""

    def __init__(self, timeline: Timeline, weather: Weather) -> None:
        self.timeline = timeline
        self.weather = weather
        self.hub: Session | None = None
        self.links: list[Link] = []
        self.tokens = Tokens(self.links, self._reachable)
        self.clients: list[Session] = []
        self.graveyard: list[Generator[None, None, int] | None] = []
        self.crash_after: dict[str, int] = {}
        self.crash: Callable[[SimulatedProcess], None] = SimulatedProcess.kill
        self.lossy_until = 0.0
        self.echoes_until: dict[str, float] = {}

    # --- sessions ---

    def open_hub(self, process: SimulatedProcess, listen: str) -> tuple[Any, str]:
        """Open a hub's session; return it with its endpoint."""
        self.hub = Session(self, process, hub=True)
        return self.hub, listen.replace(":0", ":7447")

    def open_client(self, process: SimulatedProcess) -> Session:
        """Open a client's session, linked as soon as there is a hub."""
        session = Session(self, process, hub=False)
        self.clients.append(session)
        if self.hub is not None and self._reachable(self.hub):
            self._link(session, self.hub)
        else:
            self._retry(session)
        return session

    def leave(self, session: Session) -> None:
        """Close a session; the other side notices after all earlier messages."""
        if session.hub:
            self._close_hub(session)
        elif session in self.clients:
            self.clients.remove(session)
            link = session.link
            if link is not None and not link.cut:
                link.up(lambda: self._forget(link))

    def gone(self, process: SimulatedProcess) -> None:
        """Handle the end of a process."""
        if self.hub is not None and self.hub.process is process:
            self._close_hub(self.hub)
        for session in [client for client in self.clients if client.process is process]:
            self.leave(session)

    def _close_hub(self, hub: Session) -> None:
        if self.hub is hub:
            self.hub = None
        for link in [known for known in self.links if known.hub is hub]:
            self.links.remove(link)
            chance = self.timeline.stream("resets")
            # Messages that the hub has sent before its end still arrive first.
            link.down(lambda link=link: self._lost(link))
            self.timeline.after(chance.uniform(*RESET), lambda: None)

    # --- links ---

    def _reachable(self, hub: Session) -> bool:
        return hub.process.alive and self.timeline.now >= hub.process.frozen_until

    def _link(self, session: Session, hub: Session) -> None:
        link = session.link = Link(self.timeline, self.weather, session, hub)
        self.links.append(link)
        chance = self.timeline.stream(f"links of {session.process.name}")
        steps = [lambda: self._tell_subscribers(session), lambda: self._tell_tokens(session, link)]
        # The order of the two is not defined, and members must cope with both.
        if chance.random() < TOKENS_FIRST:
            steps.reverse()
        for step in steps:
            step()
        for watch in session.watches:
            self.tokens.report(session, watch)

    def _tell_subscribers(self, session: Session) -> None:
        self.changed(session)

    def _tell_tokens(self, session: Session, link: Link) -> None:
        for token in session.tokens:
            link.up(lambda key=token.key: self.tokens.seen(link, key, there=True))

    def _retry(self, session: Session) -> None:
        chance = self.timeline.stream(f"retries of {session.process.name}")
        self.timeline.after(chance.uniform(*RETRY), lambda: self._link_again(session))

    def _link_again(self, session: Session) -> None:
        if session not in self.clients or session.link is not None or not session.process.alive:
            return
        known = any(link.client is session for link in self.links)
        frozen = self.timeline.now < session.process.frozen_until
        if self.hub is None or known or frozen or not self._reachable(self.hub):
            self._retry(session)
        else:
            self._link(session, self.hub)

    def cut(self, session: Session, noticed: tuple[float, float]) -> None:
        """Cut a client's link; client and hub notice it after the given seconds."""
        link = session.link
        if link is None or link.cut:
            return
        link.cut = True
        client, hub = noticed
        self._after(client, session.process, lambda: self._lost(link))
        self._after(hub, link.hub.process, lambda: self._forget(link))

    def _after(self, seconds: float, process: SimulatedProcess, call: Callable[[], None]) -> None:
        """Call something of a process; a frozen one is called later."""

        def notice() -> None:
            if self.timeline.now < process.frozen_until:
                self.timeline.at(process.frozen_until, notice)
            else:
                call()

        self.timeline.after(seconds, notice)

    def _lost(self, link: Link) -> None:
        """Let a client notice that its link and the tokens received over it are gone."""
        session = link.client
        # A newer link has replaced this one.
        if session.link is not link:
            return
        session.link = None
        known, session.known = list(session.known), {}
        for key in known:
            session.see(key, there=False)
        self._retry(session)

    def _forget(self, link: Link) -> None:
        """Let the hub notice that a link, its subscriptions and its tokens are gone."""
        if link not in self.links:
            return
        self.links.remove(link)
        link.cut = True
        for key in list(link.tokens):
            self.tokens.unseen(link, key)

    def freeze(self, process: SimulatedProcess, seconds: float) -> None:
        """Freeze a process; after a lease it loses its links."""
        process.freeze(seconds)
        # Shorter than a lease: only a delay is noticed.
        if seconds <= LEASE:
            return
        self.timeline.after(LEASE, lambda: self._lease_over(process))

    def _lease_over(self, process: SimulatedProcess) -> None:
        if self.timeline.now >= process.frozen_until:
            return
        for link in list(self.links):
            if process in (link.client.process, link.hub.process):
                self.cut(link.client, (0.0, 0.0))

    # --- messages ---

    def changed(self, session: Session) -> None:
        """Send a client's changed subscriptions to the hub."""
        link = session.link
        if link is not None and not session.hub:
            patterns = {subscriber.pattern: None for subscriber in session.subscribers}
            link.up(lambda: link.hears(patterns))

    def publish(self, session: Session, key: str, data: bytes, *, droppable: bool) -> None:
        """Send a message to all other subscribers."""
        if not self._may_speak(session.process):
            return
        if session.hub:
            self._spread(session, None, key, data, droppable=droppable)
        elif session.link is not None:
            link = session.link
            link.up(lambda: self._carried(link, key, data))

    def _carried(self, link: Link, key: str, data: bytes) -> None:
        link.hub.hear(key, data)
        # Not to the sender, whose own subscribers have received it in `Session.publish`.
        self._spread(link.hub, link, key, data, droppable=False)
        echoes = self.timeline.now < self.echoes_until.get(link.client.process.name, 0.0)
        # Only replies may arrive twice; the other messages are sent once on an ordered link.
        if echoes and declaration(data, _STAMP).awaited:
            chance = self.timeline.stream(f"echoes of {link.client.process.name}")
            self.timeline.after(chance.uniform(*ECHO), lambda: self._echo(key, data))

    def _echo(self, key: str, data: bytes) -> None:
        """Deliver a reply a second time, later, to the current hub."""
        if self.hub is not None and self._reachable(self.hub):
            self.hub.hear(key, data)

    def _spread(
        self, hub: Session, source: Link | None, key: str, data: bytes, *, droppable: bool
    ) -> None:
        for link in list(self.links):
            if link.hub is hub and link is not source and self._listens(link, key):
                if droppable and self._drops(link):
                    continue
                link.down(lambda link=link: link.client.hear(key, data))

    def _listens(self, link: Link, key: str) -> bool:
        # Cached, because every message is compared with the patterns of every link.
        known = link.listens.get(key)
        if known is None:
            known = link.listens[key] = any(matches(pattern, key) for pattern in link.heard)
        return known

    def _drops(self, link: Link) -> bool:
        if self.timeline.now >= self.lossy_until:
            return False
        return self.timeline.stream(f"room for {link.client.process.name}").random() < LOST

    def _may_speak(self, process: SimulatedProcess) -> bool:
        """Whether a process may send; one with a pending crash may crash here."""
        if not process.alive:
            return False
        left = self.crash_after.get(process.name)
        if left is None:
            return True
        if left > 0:
            self.crash_after[process.name] = left - 1
            return True
        # The crash happens instead of this message, so a history can end between any two messages.
        del self.crash_after[process.name]
        self.crash(process)
        return False

    # --- questions ---

    def ask(
        self, session: Session, key: str, data: bytes, answered: Callable[[bytes], None]
    ) -> None:
        """Send a query to the hub; an answer may follow."""
        link = session.link
        if link is None:
            return

        def reply(answer: bytes) -> None:
            # The coordinator may crash before it answers.
            if self._may_speak(link.hub.process):
                link.down(lambda: answered(answer))

        def asked() -> None:
            for queryable in link.hub.queryables:
                if matches(queryable.pattern, key):
                    queryable.hear(Query(key, data, reply))
                    return

        link.up(asked)
