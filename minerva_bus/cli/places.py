"""The running world that a command addresses, and the identity that it uses."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from minerva_bus.cli.options import WorldTarget
from minerva_bus.errors import BusError
from minerva_bus.launch.registry import find
from minerva_bus.runtime.operator_client import Client
from minerva_bus.security.credentials import Credentials, key_folder
from minerva_bus.wording import counted


@dataclass(slots=True)
class _Identity:
    """The value of --keys, of any command."""

    keys: str = ""


_identity = _Identity()


def choose_keys(keys: str) -> None:
    """Choose the identity of this process: a folder of keys, or a certificate in it, NAME.pem."""
    _identity.keys = keys


def identity(name: str = "") -> Credentials | None:
    """The credentials of --keys; `name` selects a certificate in a folder with several.

    Raises KeysError if there is none.
    """
    if not _identity.keys:
        return None
    path = Path(_identity.keys)
    named = path.suffix == ".pem"
    return key_folder(path.parent if named else path).credentials(name, path.stem if named else "")


def client(target: WorldTarget) -> Client:
    """A connection to the world that a command addresses. Raises BusError."""
    if target.connect:
        return Client(target.connect, target.world, identity())
    entry = find(target.world)
    try:
        return Client(entry.endpoint, entry.world)
    except BusError:
        from minerva_bus.launch.process_table import (
            stopped_processes,  # Most commands do not need it.
        )

        stopped = [str(pid) for pid in stopped_processes(entry.pid)]
        if not stopped:
            raise
    raise BusError(
        f"{entry.world} does not answer: SIGSTOP or a debugger has stopped"
        f" {counted(len(stopped), 'process')} of it; to continue: kill -CONT {' '.join(stopped)}"
    )


def place(
    target: WorldTarget, own: Credentials | None = None, preferred: str = ""
) -> tuple[str, str]:
    """Endpoint and name of the world that a command addresses. Raises BusError.

    `preferred`: name of a world file, to choose among several worlds of this machine.
    """
    if not target.connect:
        entry = find(target.world, preferred)
        return entry.endpoint, entry.world
    if target.world:
        return target.connect, target.world
    with Client(target.connect, own=own) as connected:
        return target.connect, connected.world
