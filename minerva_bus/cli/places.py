"""The running world that a command addresses, and the identity that it uses."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from minerva_bus.launch.registry import find
from minerva_bus.runtime.client import Client
from minerva_bus.security.credentials import Credentials


@dataclass(slots=True)
class _Chosen:
    """The identity chosen on the command line, for any command."""

    keys: str = ""


_chosen = _Chosen()


def choose_keys(keys: str) -> None:
    """Choose the identity of this process: a folder of keys, or a certificate in it, NAME.pem."""
    _chosen.keys = keys


def identity(name: str = "") -> Credentials | None:
    """The credentials of --keys; `name` selects a certificate in a folder with several.

    Raises KeysError if there is none.
    """
    if not _chosen.keys:
        return None
    from minerva_bus.security.keys import Keys

    path = Path(_chosen.keys)
    named = path.suffix == ".pem"
    return Keys(path.parent if named else path).credentials(name, path.stem if named else "")


def client(connect: str, world: str) -> Client:
    """A connection to the world that --connect and --world choose. Raises BusError."""
    if connect:
        return Client(connect, world, identity())
    entry = find(world)
    return Client(entry.endpoint, entry.world)


def place(connect: str, world: str, own: Credentials | None = None) -> tuple[str, str]:
    """Endpoint and name of the world that --connect and --world choose. Raises BusError."""
    if connect and world:
        return connect, world
    if connect:
        with Client(connect, own=own) as asked:
            return connect, asked.world
    entry = find(world)
    return entry.endpoint, entry.world
