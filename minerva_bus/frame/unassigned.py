"""Logs which agents have no host, once per change."""

from __future__ import annotations

from collections.abc import Collection, Iterable

from minerva_bus.frame.instructions import Instructions
from minerva_bus.wording import counted


class UnassignedLog:
    """State of the log about agents without a host."""

    def __init__(self, limit: int) -> None:
        """`limit`: maximum number of agents of one host; 0: any number."""
        self._limit = limit
        self._count = 0
        self._offered: set[frozenset[str]] = set()
        self._reported: set[frozenset[str]] = set()

    def count(self, agents: int, *, rules: bool, out: Instructions) -> None:
        """Log the number of agents without a host, if it has changed and rules or limits apply."""
        if agents == self._count or not (rules or self._limit):
            return
        self._count = agents
        if not agents:
            out.log("placement", "every agent has a host again")
            return
        verbs = "has no host and does" if agents == 1 else "have no host and do"
        limit = f"a host takes {self._limit} (agents_per_host)"
        reason = limit if self._limit else "see [placement]"
        out.log(
            "placement",
            f"{counted(agents, 'agent')} {verbs} not evolve: {reason}; attach another host",
        )

    def kinds(
        self,
        offers: Iterable[frozenset[str]],
        unassigned: Collection[frozenset[str]],
        out: Instructions,
    ) -> None:
        """Log, once, the kinds that no host has ever offered: the world may lack a process.

        If a host that offered them is gone, its loss has been logged.
        """
        # Also of hosts that are gone: their loss has been logged already.
        self._offered.update(offers)
        missing = {
            kinds for kinds in unassigned if not any(kinds <= offered for offered in self._offered)
        }
        for kinds in sorted(map(sorted, missing - self._reported)):
            names = f"all of {', '.join(kinds)}" if len(kinds) > 1 else kinds[0]
            still = "these agents do not evolve; attach a host that does"
            out.log("placement", f"no host offers {names}: {still}")
        self._reported |= missing
