"""The process whose place a standby waits for: whether it has ended, and not only lost its link."""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false
from __future__ import annotations

import zenoh

from minerva_bus.runtime.system import System
from minerva_bus.wire.keys import Keys, linked_at, number_of_region


class Predecessor:
    """The process that has the name of a member at present.

    A region announces where it receives parcels. If its machine refuses links there, the process
    has ended; a machine that has disappeared, or is behind a line that is cut, refuses nothing.
    """

    def __init__(self, name: str, keys: Keys, system: System) -> None:
        self._key = keys.link(name)
        self._is_region = number_of_region(name) is not None
        self._system = system
        self._endpoint = ""

    def note(self, session: zenoh.Session) -> None:
        """Note where it receives parcels, while it has the name."""
        if not self._is_region:
            return
        for reply in session.liveliness().get(self._key, timeout=1.0):
            if reply.ok is not None:
                self._endpoint = linked_at(str(reply.ok.key_expr))[1]

    @property
    def has_ended(self) -> bool:
        """Whether it is known to have ended; may take a second if its machine is gone."""
        return bool(self._endpoint) and self._system.refuses(self._endpoint)
