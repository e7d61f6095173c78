"""A member's name in a world: whoever has declared its token bears it."""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false
from __future__ import annotations

from collections.abc import Callable, Iterator

import zenoh

from minerva_bus.errors import BusError


class Name:
    """A name that a member wants, has or has given back; `key` is its token's."""

    def __init__(self, name: str, key: str) -> None:
        self._name = name
        self._key = key
        self._token: zenoh.LivelinessToken | None = None

    def until_free(
        self, session: zenoh.Session, clock: Callable[[], float], within: float
    ) -> Iterator[None]:
        """CheckConnection again and again until it is free, with a pause at each turn.

        Raises BusError where another one bears it for so many seconds more: it is no dead one's,
        which is free after some milliseconds.
        """
        until = clock() + within
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
