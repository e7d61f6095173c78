"""Which running world a command is about."""

from __future__ import annotations

from minerva_bus.bus.client import Client
from minerva_bus.launch.registry import find


def client(connect: str, world: str) -> Client:
    """A connection to the world that --connect and --world choose. Raises BusError."""
    if connect:
        return Client(connect, world)
    found = find(world)
    return Client(found.endpoint, found.world)


def place(connect: str, world: str) -> tuple[str, str]:
    """Endpoint and name of the world that --connect and --world choose. Raises BusError."""
    if connect and world:
        return connect, world
    if connect:
        with Client(connect) as asked:
            return connect, asked.world
    found = find(world)
    return found.endpoint, found.world
