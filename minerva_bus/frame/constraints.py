"""Placement rules: which hosts may evolve which agents, from [placement] in a world file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from typing import TypeAlias

Offers: TypeAlias = Mapping[str, frozenset[str]]
"""The kinds of agents that each host offers to evolve, by host."""


@dataclass(frozen=True, slots=True)
class Rule:
    """Restricts the hosts that may evolve agents of one kind.

    `only`: hosts whose names match one of these patterns (`*` and `?`); empty: any host.
    `near`: hosts on the same machine as the member of this name.
    """

    only: tuple[str, ...] = ()
    near: str = ""

    def allows(self, host: str, machines: Mapping[str, str]) -> bool:
        """Whether a host may evolve such agents; `machines` maps members to machines."""
        # `fnmatch` ignores case on some platforms, but names of members are case-sensitive.
        if self.only and not any(fnmatchcase(host, pattern) for pattern in self.only):
            return False
        if not self.near:
            return True
        # Without the member there is no machine to be near to. The empty text cannot stand for a
        # missing machine, because a host's machine may be the empty text.
        return self.near in machines and machines[self.near] == machines.get(host)


@dataclass(frozen=True, slots=True)
class PlacementRules:
    """Rules by kind, and the maximum number of agents per host; 0: any number."""

    rules: Mapping[str, Rule] = field(default_factory=dict[str, Rule])
    agents_per_host: int = 0

    @property
    def neighbours(self) -> frozenset[str]:
        """The members to whose machines the rules refer."""
        return frozenset(rule.near for rule in self.rules.values() if rule.near)

    def allowed(self, offers: Offers, machines: Mapping[str, str]) -> dict[str, frozenset[str]]:
        """The offers of hosts that the rules allow; a host may be left with no kinds."""
        if not self.rules:
            return dict(offers)
        return {host: self._left(host, kinds, machines) for host, kinds in offers.items()}

    def _left(
        self, host: str, kinds: frozenset[str], machines: Mapping[str, str]
    ) -> frozenset[str]:
        return frozenset(
            kind
            for kind in kinds
            if kind not in self.rules or self.rules[kind].allows(host, machines)
        )
