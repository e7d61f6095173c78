"""Who somebody is on the bus, and what the world lets them do: roles, rights, certificates."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

AGENT, GENERATOR, VIEW, OPERATOR = "agent", "generator", "view", "operator"
HUB, ROUTER = "coordinator", "router"
ROLES: Final = {
    AGENT: "evolves agents",
    GENERATOR: "makes events, publishes and hears readings",
    VIEW: "draws views, and reads what the world says of itself",
    OPERATOR: "reads, and gives orders: pause, stop, pub ...",
    HUB: "runs the world; nobody else speaks as the coordinator",
    ROUTER: "a Zenoh router between networks, trusted with whatever it carries",
}
"""What a certificate can be for."""

SERVERS: Final = frozenset({HUB, ROUTER})
"""Roles of those whom others connect to."""

SECURED: Final = ("tls", "quic")
"""Protocols of endpoints whose links show certificates."""
FAMILY: Final = "-*"
"""How the common name of a family ends: by hosts-* one may come in as hosts-a, as hosts-b, ..."""


@dataclass(frozen=True, slots=True)
class Rights:
    """What a certificate is for.

    `name` is its common name: somebody's, or a family's. `kinds`, `events` and `topics` are those
    that it is confined to; empty: all that its roles allow. `revoked`: it counts no more.
    """

    name: str
    roles: frozenset[str]
    kinds: frozenset[str] = frozenset()
    events: frozenset[str] = frozenset()
    topics: frozenset[str] = frozenset()
    revoked: bool = False

    def may(self, *roles: str) -> bool:
        """Whether it has one of these roles."""
        return not self.revoked and not self.roles.isdisjoint(roles)


def family_start(name: str) -> str:
    """What the names of a family begin with; empty where a common name is somebody's own."""
    return name.removesuffix("*") if name.endswith(FAMILY) else ""


def covers(name: str, member: str) -> bool:
    """Whether one may come in as this member by a certificate of this common name."""
    start = family_start(name)
    return member.startswith(start) if start else member == name


def overlap(one: str, other: str) -> bool:
    """Whether there is a name under which one may come in by either of two common names."""
    return covers(one, other.removesuffix("*")) or covers(other, one.removesuffix("*"))


def rights_of(member: str, rights: Mapping[str, Rights]) -> Rights | None:
    """What somebody may do, its own certificate's or its family's: one that was revoked, if any.

    `rights` are by common names; None where there are none of this member.
    """
    found = [rights[name] for name in _common_names(member) if name in rights]
    return min(found, key=lambda one: not one.revoked, default=None)


def _common_names(member: str) -> Iterator[str]:
    yield member
    end = member.find("-")
    while end >= 0:
        yield member[:end] + FAMILY
        end = member.find("-", end + 1)


@dataclass(frozen=True, slots=True)
class Credentials:
    """Files by which a process shows who it is: PEM, the key unencrypted and its owner's alone."""

    name: str
    authority: Path
    certificate: Path
    key: Path
    roles: frozenset[str]

    @property
    def operates(self) -> bool:
        """Whether it may give orders."""
        return OPERATOR in self.roles
