"""Greetings that were not answered: one may have been lost on its way.

Where a link has come back, a member's token can be known before what it listens to is.
"""

from __future__ import annotations

GREETED_AGAIN = 1.0
"""Seconds after which who has not answered is greeted once more."""


class Greetings:
    """Who was greeted when, and has not said hello since."""

    def __init__(self) -> None:
        self._greeted: dict[str, float] = {}

    def sent(self, member: str, now: float) -> None:
        """A member is greeted now."""
        self._greeted[member] = now

    def answered(self, member: str) -> None:
        """A member has said hello."""
        self._greeted.pop(member, None)

    def unanswered(self, now: float) -> list[str]:
        """Those who have not answered for a while, sorted; each is named once."""
        found = sorted(one for one, at in self._greeted.items() if now >= at + GREETED_AGAIN)
        for name in found:
            del self._greeted[name]
        return found
