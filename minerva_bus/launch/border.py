"""Who may come into a world from elsewhere: [bus] connect, keys and audit, [limits] and more."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from minerva_bus.errors import BusError, KeysError
from minerva_bus.launch.runtime_folder import runtime_folder
from minerva_bus.launch.table import Table
from minerva_bus.runtime.endpoints import check_endpoint, check_listening
from minerva_bus.runtime.guard import LOCAL_KIND, Security
from minerva_bus.security.credentials import Rights, family_start, rights_of
from minerva_bus.wire.keys import COORDINATOR
from minerva_bus.wire.limits import DEFAULT, Limits

LONGEST_PATH: Final = 100
"""Bytes of a socket's path: systems take from 104 to 108, and Zenoh adds a lock beside it."""


@dataclass(frozen=True, slots=True)
class BorderOverrides:
    """What a command line says of it instead of the world file."""

    connect: tuple[str, ...] = ()
    keys: str = ""
    insecure: bool = False
    audit: bool = False


@dataclass(frozen=True, slots=True)
class Border:
    """Who may come in, and how much anybody may say.

    `keys` is the folder of those who belong (None: there is none), `routers` are Zenoh routers that
    the coordinator joins. `audit`: what Zenoh itself drops is named and counted.
    """

    keys: Path | None = None
    routers: tuple[str, ...] = ()
    limits: Limits = DEFAULT
    audit: bool = False


def read_border(
    bus: Table, limits: Table, listen: str, beside: Path, given: BorderOverrides
) -> Border:
    """What a world file says, checked. Raises WorldFileError, and BusError for open doors."""
    own_keys, own_routers = bus.text("keys"), bus.texts("connect")
    keys = Path(given.keys) if given.keys else beside / own_keys if own_keys else None
    routers = given.connect or own_routers
    check_listening(listen, keys=keys is not None, insecure=given.insecure)
    for router in routers:
        asked = check_endpoint(router)
        if not (asked.secured or asked.local or given.insecure):
            raise BusError(f"{router} is no secured link: join tls/{asked.host}:{asked.port} with"
                           " --keys FOLDER, or insist with --insecure")  # fmt: skip
        check_listening(router, keys=keys is not None, insecure=given.insecure)
    secured = any(check_endpoint(one).secured for one in (listen, *routers))
    if keys is not None and not secured:
        raise BusError(f"keys are for secured links, and {listen} is none;"
                       " listen at tls/0.0.0.0:7447 (--listen)")  # fmt: skip
    audit = bus.truth("audit", False) or given.audit
    if audit and keys is None:
        raise BusError("an audit is of those who come in by keys: name their folder (--keys), and"
                       " listen at tls/0.0.0.0:7447 (--listen)")  # fmt: skip
    return Border(keys, tuple(routers), _limits(limits), audit)


def _limits(table: Table) -> Limits:
    plain = DEFAULT
    found = Limits(
        message_bytes=table.whole("message_bytes", plain.message_bytes, 1024),
        messages=table.whole("messages", plain.messages, 1),
        bytes=table.whole("bytes", plain.bytes, 1024),
        values=table.whole("values", plain.values, 100),
        answer_values=table.whole("answer_values", plain.answer_values, 1000),
        single_events=table.whole("single_events", plain.single_events, 1),
        events=table.whole("events", plain.events, 1),
    )
    table.done()
    return found


def security(border: Border, world: str, started: Iterable[str] = ()) -> Security | None:
    """What secures the coordinator's session. Raises KeysError, and BusError for the local socket.

    Processes of this machine come in by a socket in a folder that is its owner's alone. No family
    may have names of those that the world has `started` itself.
    """
    if border.keys is None:
        return None
    from minerva_bus.security.keys import Keys

    keys = Keys(border.keys)
    own = keys.credentials(COORDINATOR)
    _check_families(keys.rights(), started)
    return Security(own, local_endpoint(world), keys.rights, keys.stamp, border.audit)


def _check_families(rights: Mapping[str, Rights], started: Iterable[str]) -> None:
    for member in started:
        one = rights_of(member, rights)
        if one is not None and family_start(one.name) and not one.revoked:
            raise KeysError(
                f"{one.name} lets others speak as {member}, a process that the world starts itself:"
                " call either of them otherwise"
            )


def local_endpoint(world: str) -> str:
    """Where processes of this machine find a secured world. Raises BusError."""
    place = runtime_folder()
    path = str((place / f"{world}.sock").absolute())
    if len(os.fsencode(path)) > LONGEST_PATH:
        raise BusError(
            f"{path} is too long for a socket ({LONGEST_PATH} bytes); MINERVA_RUNTIME_DIR names a"
            " folder with a shorter name"
        )
    try:
        found = place.stat()
    except OSError as error:
        raise BusError(f"{place} cannot hold what runs here: {error.strerror}") from None
    if found.st_uid != os.getuid() or found.st_mode & 0o077:
        raise BusError(
            f"{place} is open to others, and whoever can write there belongs to the world; chmod"
            " 700 it, or let MINERVA_RUNTIME_DIR name another folder"
        )
    return f"{LOCAL_KIND}/{path}"
