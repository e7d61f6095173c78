"""A member's name in a world: whoever has declared its token bears it."""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false
from __future__ import annotations

from collections.abc import Callable, Iterator

import zenoh

from minerva_bus.errors import BusError

FREE_WITHIN = 2.0
"""Seconds after which a name that is taken is another's: a dead one's is free after some ms."""


class Name:
    """A name that a member wants, has or has given back; `key` is its token's."""

    def __init__(self, name: str, key: str) -> None:
        self._name = name
        self._key = key
        self._token: zenoh.LivelinessToken | None = None

    def until_free(self, session: zenoh.Session, clock: Callable[[], float]) -> Iterator[None]:
        """Look again and again until it is free, with a pause at each turn.

        Raises BusError where another one goes on to bear it.
        """
        until = clock() + FREE_WITHIN
        while self.taken(session):
            if clock() > until:
                raise BusError(
                    f"there is a member {self._name!r} in the world already;"
                    " choose another name (--name)"
                )
            yield

    def taken(self, session: zenoh.Session) -> bool:
        """Whether somebody bears it."""
        return bool(list(session.liveliness().get(self._key, timeout=1.0)))

    def take(self, session: zenoh.Session) -> None:
        """Bear it from now on."""
        self._token = session.liveliness().declare_token(self._key)

    def give_back(self) -> None:
        """Bear it no more."""
        if self._token is not None:
            self._token.undeclare()
            self._token = None
