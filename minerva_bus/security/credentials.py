"""Identities on the bus and their permissions: roles, rights and credentials."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final, Protocol

from minerva_bus.entry_points import entries
from minerva_bus.errors import KeysError
from minerva_bus.values import fast_dataclass

AGENT, GENERATOR, VIEW, OPERATOR = "agent", "generator", "view", "operator"
HUB, ROUTER = "coordinator", "router"
ROLES: Final = {
    AGENT: "evolves agents",
    GENERATOR: "generates events, publishes and receives readings",
    VIEW: "draws views, reads the state of the world",
    OPERATOR: "reads the state of the world and sends commands: pause, stop, pub ...",
    HUB: "runs the world as its coordinator",
    ROUTER: "Zenoh router between networks; it is trusted with everything it carries",
}
"""The roles of certificates."""

SERVERS: Final = frozenset({HUB, ROUTER})
"""Roles of processes that accept connections."""

SECURED: Final = ("tls", "quic")
"""Protocols of endpoints that authenticate by certificates."""

FAMILY: Final = "-*"
"""End of a family's common name: hosts-* is valid for the members hosts-a, hosts-b, ..."""


@fast_dataclass
class Rights:
    """The rights of a certificate.

    `name` is its common name: that of a member or of a family. `kinds` and `events` restrict its
    roles to these; empty means all. It publishes on `topics` alone.
    """

    name: str
    roles: frozenset[str]
    kinds: frozenset[str] = frozenset()
    events: frozenset[str] = frozenset()
    topics: frozenset[str] = frozenset()
    revoked: bool = False

    def may(self, *roles: str) -> bool:
        """Whether it has one of these roles."""
        # Revocation is part of this check, so that no caller can forget it.
        return not self.revoked and not self.roles.isdisjoint(roles)


def family_start(name: str) -> str:
    """Common start of a family's names; empty for the common name of a single member."""
    return name.removesuffix("*") if name.endswith(FAMILY) else ""


def covers(name: str, member: str) -> bool:
    """Whether a certificate with this common name is valid for a member."""
    start = family_start(name)
    return member.startswith(start) if start else member == name


def overlap(first: str, second: str) -> bool:
    """Whether two common names are valid for the same member."""
    return covers(first, second.removesuffix("*")) or covers(second, first.removesuffix("*"))


def rights_of(member: str, rights: Mapping[str, Rights]) -> Rights | None:
    """The rights of a member by its own certificate or its family's; None without either.

    `rights` are by common name. A revoked certificate takes precedence over a valid one.
    """
    held = [rights[name] for name in _common_names(member) if name in rights]
    return min(held, key=lambda holder: not holder.revoked, default=None)


def _common_names(member: str) -> Iterator[str]:
    yield member
    end = member.find("-")
    while end >= 0:
        # A name with several hyphens may belong to a family at each of them.
        yield member[:end] + FAMILY
        end = member.find("-", end + 1)


@fast_dataclass
class Credentials:
    """PEM files with which a process authenticates; only their owner may read the plain key."""

    name: str
    authority: Path
    certificate: Path
    key: Path
    roles: frozenset[str]

    @property
    def operates(self) -> bool:
        """Whether it may send commands."""
        return OPERATOR in self.roles


# --- folders of keys, which an extension reads ---

KEYS: Final = "minerva.keys"
"""The entry points of classes of `KeyReader`; the first one by name reads all folders."""


class KeyReader(Protocol):
    """The keys in a folder. All methods raise KeysError if it cannot be used."""

    def rights(self) -> Mapping[str, Rights]:
        """The rights by common name, including revoked ones."""
        ...

    def credentials(self, name: str = "", bearer: str = "") -> Credentials:
        """Credentials of the member `name`, by the certificate `bearer` or the one that fits."""
        ...

    def stamp(self) -> object:
        """A value that changes when a certificate is issued or revoked. Raises OSError."""
        ...


def key_folder(path: Path) -> KeyReader:
    """The keys in a folder. Raises KeysError, also without an extension that reads it."""
    for _, entry in sorted(entries(KEYS).items()):
        return entry.load()(path)
    raise KeysError(f"--keys {path}: keys need an extension that reads them ({KEYS}); install it")
