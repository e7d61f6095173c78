"""Rendezvous hashing of agents to hosts: few agents move when hosts join or leave."""

from __future__ import annotations

from collections.abc import Iterable
from hashlib import blake2b


def weight(host: str, agent: str) -> bytes:
    """Weight of a pair of host and agent."""
    return blake2b(f"{host}\0{agent}".encode(), digest_size=8).digest()


def place(agent: str, hosts: Iterable[str]) -> str | None:
    """The host of largest weight for an agent, or None where there are no hosts."""
    return max(hosts, key=lambda host: (weight(host, agent), host), default=None)
