"""Liveliness tokens of the simulated network: sessions declare them, watchers receive changes."""

from __future__ import annotations

from collections.abc import Callable

from tests.simulator.links import Link
from tests.simulator.sessions import Declared, Session, matches


class Tokens:
    """The tokens that travel over the links; `is_reachable` tells whether a hub answers."""

    def __init__(self, links: list[Link], is_reachable: Callable[[Session], bool]) -> None:
        self._links = links
        self._is_reachable = is_reachable

    def declare(self, session: Session, key: str, *, there: bool) -> None:
        """Declare or remove a token of a session."""
        if session.hub:
            self._show_token(session, key, there=there)
        elif session.link is not None:
            link = session.link
            link.up(lambda: self.seen(link, key, there=there))

    def seen(self, link: Link, key: str, *, there: bool) -> None:
        """Let the hub notice a client's token, or its end."""
        if there and key not in link.tokens:
            before = self._count(link.hub, key)
            link.tokens.append(key)
            # A token is visible as long as any session has it.
            if not before:
                self._show_token(link.hub, key, there=True)
        elif not there and key in link.tokens:
            self.unseen(link, key)

    def unseen(self, link: Link, key: str) -> None:
        """Let the hub notice the end of a token that it has seen over a link."""
        link.tokens.remove(key)
        if not self._count(link.hub, key):
            self._show_token(link.hub, key, there=False)

    def _count(self, hub: Session, key: str) -> int:
        own = sum(token.key == key for token in hub.tokens)
        return own + sum(key in link.tokens for link in self._links if link.hub is hub)

    def _show_token(self, hub: Session, key: str, *, there: bool) -> None:
        hub.see(key, there=there)
        for link in list(self._links):
            if link.hub is hub and any(
                matches(watch.pattern, key) for watch in link.client.watches
            ):
                self._tell_of(link, key, there=there)

    def _tell_of(self, link: Link, key: str, *, there: bool) -> None:
        session = link.client

        def notify() -> None:
            # From a former link, or without a change: watchers receive changes only.
            if session.link is not link or (key in session.known) is there:
                return
            if there:
                session.known[key] = None
            else:
                session.known.pop(key)
            session.see(key, there=there)

        link.down(notify)

    def report(self, session: Session, watch: Declared) -> None:
        """Notify a new watcher of the present tokens."""
        if session.hub:
            return  # The first coordinator has no predecessor.
        link = session.link
        if link is not None:

            def asked() -> None:
                for key in self.matching(session, watch.pattern):
                    self._tell_of(link, key, there=True)

            link.up(asked)

    def matching(self, session: Session, pattern: str) -> list[str]:
        """Tokens that are visible to the hub, sorted; none if it is unreachable."""
        link = session.link
        hub = session if session.hub else None if link is None or link.cut else link.hub
        if hub is None or not self._is_reachable(hub):
            return []
        keys = {token.key for token in hub.tokens}
        for link in self._links:
            if link.hub is hub:
                keys.update(link.tokens)
        return sorted(key for key in keys if matches(pattern, key))
