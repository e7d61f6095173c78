"""Access to a world from other machines: certificates, routers and limits."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from minerva_bus.errors import BusError, KeysError
from minerva_bus.launch.registry import runtime_folder
from minerva_bus.launch.toml_tables import Table
from minerva_bus.runtime.admission import LOCAL_KIND, Security
from minerva_bus.runtime.endpoints import check_endpoint, check_listening
from minerva_bus.security.credentials import Rights, family_start, rights_of
from minerva_bus.settings.kinds import whole
from minerva_bus.settings.tables import BusSettings
from minerva_bus.wire.keys import COORDINATOR
from minerva_bus.wire.message_limits import DEFAULT, Limits, configurable_limits

MAX_PATH_BYTES: Final = 100
"""Longest path of a socket: systems accept 104 to 108; Zenoh adds a lock file beside it."""


@dataclass(frozen=True, slots=True)
class Access:
    """Admission of remote members, and limits for messages of all members.

    `keys` is the folder of certificates (None: remote members cannot join), `routers` are Zenoh
    routers that the coordinator joins.
    """

    keys: Path | None = None
    routers: tuple[str, ...] = ()
    limits: Limits = DEFAULT


def read_access(top: Table, bus: BusSettings, folder: Path) -> Access:
    """The access rules of a world, checked; `folder` has its world file.

    Raises WorldFileError, and BusError for a world that any process could join.
    """
    # A path in the world file is relative to this file, one on the command line to the current
    # folder.
    keys = Path(bus.keys) if "keys" in top.overrides.values else folder / bus.keys
    keys = keys if bus.keys else None
    check_listening(bus.listen, keys=keys is not None, insecure=bus.insecure)
    # A router gives access to the coordinator like its own endpoint, so the same rules apply.
    for router in bus.connect:
        endpoint = check_endpoint(router)
        if not (endpoint.secured or endpoint.local or bus.insecure):
            raise BusError(
                f"{router} is not a secured link: join tls/{endpoint.host}:{endpoint.port} with"
                " --keys FOLDER, or insist with --insecure"
            )
        check_listening(router, keys=keys is not None, insecure=bus.insecure)
    # Certificates take effect on TLS links only: with keys and without such a link, no member would
    # be checked, contrary to the owner's intention.
    secured = any(check_endpoint(endpoint).secured for endpoint in (bus.listen, *bus.connect))
    if keys is not None and not secured:
        raise BusError(
            f"keys are for secured links, and {bus.listen} is not one;"
            " listen at tls/0.0.0.0:7447 (--listen)"
        )
    return Access(keys, bus.connect, _limits(top.table("limits")))


def _limits(table: Table) -> Limits:
    values = {
        name: table.get(name, whole(least), getattr(DEFAULT, name))
        for name, least in configurable_limits().items()
    }
    return replace(DEFAULT, **values)


def security(access: Access, world: str, started: Iterable[str] = ()) -> Security | None:
    """Security of the coordinator's session. Raises KeysError and, for the socket, BusError.

    Local processes connect through a socket in a folder that only its owner can open. No family of
    certificates may contain the name of a process that the world has `started`.
    """
    if access.keys is None:
        return None
    from minerva_bus.security.authority import KeyFolder

    keys = KeyFolder(access.keys)
    own = keys.credentials(COORDINATOR)
    _check_families(keys.rights(), started)
    # `rights` and `stamp` are functions, because certificates are issued and revoked while the
    # world runs.
    return Security(own, local_endpoint(world), keys.rights, keys.stamp)


def _check_families(rights: Mapping[str, Rights], started: Iterable[str]) -> None:
    for member in started:
        granted = rights_of(member, rights)
        if granted is not None and family_start(granted.name) and not granted.revoked:
            raise KeysError(
                f"{granted.name} allows others to act as {member}, a process that the world starts:"
                " rename either of them"
            )


def local_endpoint(world: str) -> str:
    """The endpoint at which local processes reach a secured world. Raises BusError."""
    folder = runtime_folder()
    path = str((folder / f"{world}.sock").absolute())
    if len(os.fsencode(path)) > MAX_PATH_BYTES:
        raise BusError(
            f"{path} is too long for a socket ({MAX_PATH_BYTES} bytes); set MINERVA_RUNTIME_DIR to"
            " a folder with a shorter path"
        )
    try:
        status = folder.stat()
    except OSError as error:
        raise BusError(f"cannot use {folder} for running worlds: {error.strerror}") from None
    # Stricter than `check_runtime_folder`: any user who can search the folder can open the socket,
    # and the local link has no certificates.
    if status.st_uid != os.getuid() or status.st_mode & 0o077:
        raise BusError(
            f"{folder} is accessible to other users, who could join the world through it; chmod 700"
            " it, or set MINERVA_RUNTIME_DIR to another folder"
        )
    return f"{LOCAL_KIND}/{path}"
