"""Which running world a command is about, and who gives the command."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from minerva_bus.launch.registry import find
from minerva_bus.runtime.client import Client
from minerva_bus.security.credentials import Credentials


@dataclass(slots=True)
class _Chosen:
    """What the command line has said once, for whichever command it is."""

    keys: str = ""


_chosen = _Chosen()


def choose_keys(keys: str) -> None:
    """Let this process be who its keys say: a folder, or one's certificate in it, NAME.pem."""
    _chosen.keys = keys


def identity(name: str = "") -> Credentials | None:
    """Who this process is, by --keys; `name` is whose keys they should be in a folder of several.

    Raises KeysError where there are none of these.
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
    found = find(world)
    return Client(found.endpoint, found.world)


def place(connect: str, world: str, own: Credentials | None = None) -> tuple[str, str]:
    """Endpoint and name of the world that --connect and --world choose. Raises BusError."""
    if connect and world:
        return connect, world
    if connect:
        with Client(connect, own=own) as asked:
            return connect, asked.world
    found = find(world)
    return found.endpoint, found.world
