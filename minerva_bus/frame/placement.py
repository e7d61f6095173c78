"""Which host evolves which agent: rendezvous hashing, so that few move when hosts come and go."""

from __future__ import annotations

from collections.abc import Iterable
from hashlib import blake2b


def weight(host: str, agent: str) -> bytes:
    """How strongly a host and an agent attract each other."""
    return blake2b(f"{host}\0{agent}".encode(), digest_size=8).digest()


def place(agent: str, hosts: Iterable[str]) -> str | None:
    """The host for an agent among those that can evolve it; None where there is none."""
    return max(hosts, key=lambda host: (weight(host, agent), host), default=None)
