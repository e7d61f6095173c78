"""A claim to the name of a member: of several processes that find it free, one takes it."""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false
from __future__ import annotations

import secrets

import zenoh

from minerva_bus.wire.keys import Keys


class NameClaim:
    """The liveliness token of a process that is about to take a member's name.

    A process declares its claim first and looks for others then, so of two processes at least the
    later one sees the other. The claim stays until the process has the name, whose own token shows
    that from then on.
    """

    def __init__(self, keys: Keys, member: str) -> None:
        self._own = keys.claim(member, secrets.token_hex(8))
        self._all = keys.claim(member)
        self._token: zenoh.LivelinessToken | None = None

    def granted(self, session: zenoh.Session) -> bool:
        """Claim the name; returns whether no other process does.

        Of several claims the smallest stays, and is granted once the others are withdrawn.
        """
        others = self._others(session)
        if self._token is None:
            if others:
                return False
            self._token = session.liveliness().declare_token(self._own)
            others = self._others(session)
        if others and min(others) < self._own:
            self.withdraw()
        return not others

    def withdraw(self) -> None:
        """Give up the claim."""
        if self._token is not None:
            self._token.undeclare()
            self._token = None

    def _others(self, session: zenoh.Session) -> list[str]:
        replies = session.liveliness().get(self._all, timeout=1.0)
        keys = [str(reply.ok.key_expr) for reply in replies if reply.ok is not None]
        return [key for key in keys if key != self._own]
