"""A small certificate authority in a folder: who belongs to a world's bus.

    ca.pem, ca.key        the authority; its key is needed to issue and to revoke, and nowhere else
    crl.pem               what it has revoked
    NAME.pem, NAME.key    somebody's certificate and key, or those of the family NAME-*

Folders that are made have the mode 0700, keys 0600.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from datetime import datetime
from pathlib import Path
from typing import Final

from minerva_bus.errors import KeysError, MisuseError, nearest
from minerva_bus.security.certificates import (
    Authority,
    Issued,
    Wanted,
    certificate_pem,
    key_pem,
    now,
    read_certificate,
    read_issued,
    read_key,
    read_revoked,
)
from minerva_bus.security.credentials import (
    FAMILY,
    HUB,
    ROLES,
    SERVERS,
    Credentials,
    Rights,
    covers,
    family_start,
    overlap,
)
from minerva_bus.wire.keys import COORDINATOR, checked_name, is_name

AUTHORITY_DAYS: Final = 3650
_AUTHORITY, _REVOKED = "ca", "crl"


class Keys:
    """The keys in a folder. `at` is what time it is, for those who know better than the clock."""

    def __init__(self, folder: Path, at: datetime | None = None) -> None:
        self.folder = folder
        self.now = at or now()

    # --- making ---

    def init(self, hosts: Iterable[str] = (), days: int = AUTHORITY_DAYS) -> Issued:
        """Make the authority, and the coordinator's certificate. Raises KeysError."""
        if self._has(_AUTHORITY):
            raise KeysError(f"{self.folder} has an authority already (minerva keys list)")
        if days < 1:
            raise KeysError(f"--days must be a whole number from 1, not {days}")
        made, wanted = Authority.new(self.now, days), Wanted((HUB,), tuple(hosts))
        made.issue(COORDINATOR, wanted, self.now)  # What it cannot say leaves no half a folder.
        try:
            self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        except OSError as error:
            raise KeysError(f"{self.folder}: {error.strerror}") from None
        _put(self._path(_AUTHORITY, "key"), key_pem(made.key), 0o600)
        _put(self._path(_REVOKED, "pem"), made.revocations((), self.now), 0o644)
        _put(self._path(_AUTHORITY, "pem"), certificate_pem(made.certificate), 0o644)
        return self.issue(COORDINATOR, wanted)

    def issue(self, name: str, wanted: Wanted, *, renew: bool = False) -> Issued:
        """Make a certificate and its key; `renew`: in place of one that there is.

        Raises KeysError.
        """
        self._check(name, wanted)
        common, issued = name + FAMILY * wanted.family, self.issued()
        there = issued.get(name)
        if there is not None and there.rights.revoked:
            raise KeysError(
                f"{name} was revoked, and nobody is called so again: choose another name"
            )
        if there is not None and not renew:
            raise KeysError(
                f"{name} has a certificate until {there.ends:%Y-%m-%d}; --renew makes another in"
                " its place"
            )
        if there is not None and there.rights.name != common:
            given = "with" if family_start(there.rights.name) else "without"
            raise KeysError(f"{there.rights.name} is renewed {given} --family")
        others = [one.rights.name for one in issued.values() if one is not there]
        _check_alone(common, others, "choose another name")
        certificate, key = self._authority().issue(common, wanted, self.now)
        _put(self._path(name, "key"), key_pem(key), 0o600)
        _put(self._path(name, "pem"), certificate_pem(certificate), 0o644)
        return self.issued()[name]

    def revoke(self, name: str) -> Issued:
        """Let a certificate count no more: it is put on the list. Raises KeysError."""
        found = self._named(name)
        if found.rights.revoked:
            raise KeysError(f"{name} has been revoked already")
        authority, path = self._authority(), self._path(_REVOKED, "pem")
        serials = read_revoked(path, authority.certificate) | {found.serial}
        _put(path, authority.revocations(serials, self.now), 0o644)
        return self._named(name)

    # --- reading ---

    def issued(self) -> Mapping[str, Issued]:
        """All certificates of the folder but the authority's, by file. Raises KeysError."""
        if not self._has(_AUTHORITY):
            raise KeysError(
                f"{self.folder} has no authority, ca.pem; minerva keys init makes one, or it has"
                " not been copied with the keys"
            )
        authority, revoked = read_certificate(self._path(_AUTHORITY, "pem")), frozenset[int]()
        if self._has(_REVOKED):  # Members need not have it: the world does.
            revoked = read_revoked(self._path(_REVOKED, "pem"), authority)
        others = [
            one for one in self.folder.glob("*.pem") if one.stem not in (_AUTHORITY, _REVOKED)
        ]
        return {one.stem: read_issued(one, authority, revoked) for one in sorted(others)}

    def rights(self) -> Mapping[str, Rights]:
        """What is allowed by each common name; revoked ones among them.

        Raises KeysError, too where it cannot be known who was revoked, or who is meant by a name.
        """
        if not self._has(_REVOKED):
            raise KeysError(
                f"{self.folder} lacks crl.pem: without it, whoever was revoked would be let in"
            )
        found = {one.rights.name: one.rights for one in self.issued().values()}
        valid = [name for name, one in found.items() if not one.revoked]
        for place, name in enumerate(valid):
            _check_alone(name, valid[:place], "revoke one of them")
        return found

    def credentials(self, name: str = "", bearer: str = "") -> Credentials:
        """By which somebody shows to be `name`; without one, whoever the certificate names.

        `bearer` is which certificate of the folder; without one, that of `name` or of its family,
        and without either the only one whose key is here. One of a family who has no name has its
        process's number for one. Raises KeysError where there is none, or it counts no more.
        """
        bearer = bearer or (self._bearer(name) if name else self._only())
        found, key = self._named(bearer), self._path(bearer, "key")
        if not found.key:
            raise KeysError(f"{key} is missing: the key to {bearer}.pem")
        self._check_counts(bearer, found)
        start, pem = family_start(found.rights.name), self._path(bearer, "pem")
        if start and not (name or start).startswith(start):
            raise KeysError(f"{pem} is of the family {start}*: {name} is none of it (--name"
                            f" {start}{name})")  # fmt: skip
        own = (name or f"{start}{os.getpid()}") if start else bearer
        return Credentials(own, self._path(_AUTHORITY, "pem"), pem, key, found.rights.roles)

    def stamp(self) -> tuple[tuple[str, int], ...]:
        """What changes when a certificate is issued or revoked. Raises OSError."""
        files = sorted(self.folder.glob("*.pem"))
        return tuple([(one.name, one.stat().st_mtime_ns) for one in files])

    # --- parts ---

    def _has(self, name: str) -> bool:
        """Whether the folder has a certificate or list of this name.

        Raises KeysError where the folder cannot be read: a missing certificate would be another
        problem, with another remedy.
        """
        try:
            return self._path(name, "pem").exists()
        except OSError as error:
            raise KeysError(
                f"{self.folder} cannot be read: {error.strerror}; the process needs the right to"
                " search the folder and to read its files"
            ) from None

    def _path(self, name: str, kind: str) -> Path:
        return self.folder / f"{name}.{kind}"

    def _authority(self) -> Authority:
        certificate = read_certificate(self._path(_AUTHORITY, "pem"))
        authority = Authority(certificate, read_key(self._path(_AUTHORITY, "key")))
        if self.now > authority.ends:
            raise KeysError(
                f"the authority of {self.folder} has expired on {authority.ends:%Y-%m-%d}, and all"
                " certificates with it; minerva keys init --dir NEW makes another"
            )
        return authority

    def _check_counts(self, bearer: str, found: Issued) -> None:
        state = found.state(self.now)
        if state == "expired":
            family = " --family" if family_start(found.rights.name) else ""
            raise KeysError(
                f"the certificate of {bearer} has expired on {found.ends:%Y-%m-%d}; minerva keys"
                f" issue {bearer} --renew{family} makes another"
            )
        if state != "valid":
            raise KeysError(f"the certificate of {bearer} is {state}; ask whoever has ca.key")

    def _bearer(self, member: str) -> str:
        """Whose certificate a member has: its own, or its family's."""
        issued = self.issued().items()
        return next((file for file, one in issued if covers(one.rights.name, member)), member)

    def _only(self) -> str:
        own = [name for name, found in self.issued().items() if found.key]
        if len(own) != 1:
            raise KeysError(
                f"whose of the keys in {self.folder} ({', '.join(own) or 'none'})? Name one:"
                f" --keys {self.folder}/NAME.pem"
            )
        return own[0]

    def _named(self, name: str) -> Issued:
        issued, name = self.issued(), name.removesuffix(FAMILY)
        if name not in issued:
            there = ", ".join(one.rights.name for one in issued.values()) or "none"
            raise KeysError(
                f"{self.folder} has no certificate of {name!r}{nearest(name, list(issued))};"
                f" there are {there}"
            )
        return issued[name]

    def _check(self, name: str, wanted: Wanted) -> None:
        try:
            checked_name(name, "a certificate")
        except MisuseError as error:
            raise KeysError(str(error)) from None
        for role in wanted.roles:
            if role not in ROLES:
                raise KeysError(
                    f"--role: there is no role {role!r}{nearest(role, list(ROLES))}; there are"
                    f" {', '.join(ROLES)}"
                )
        if not wanted.roles:
            raise KeysError(f"--role is missing; roles are {', '.join(ROLES)}")
        if (name == COORDINATOR) != (HUB in wanted.roles) or name in (_AUTHORITY, _REVOKED):
            raise KeysError(f"{name} cannot be {', '.join(wanted.roles)}: choose another name")
        if wanted.family and not SERVERS.isdisjoint(wanted.roles):
            raise KeysError(f"{', '.join(wanted.roles)}: there is one of each name, not a family")
        if wanted.family and not is_name(f"{name}-a"):
            raise KeysError(f"{name} is too long for a family: its members' names begin with it")
        if wanted.days < 1:
            raise KeysError(f"--days must be a whole number from 1, not {wanted.days}")


def _check_alone(name: str, others: Iterable[str], otherwise: str) -> None:
    """Raises KeysError where somebody could come in under one name by two certificates."""
    for other in others:
        if overlap(name, other):
            raise KeysError(f"{name} and {other} have names in common: {otherwise}")


def _put(path: Path, data: bytes, mode: int) -> None:
    """Write a file whole, with its mode from the first byte on."""
    beside = path.with_suffix(f".{os.getpid()}.new")
    try:
        descriptor = os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
        with os.fdopen(descriptor, "wb") as file:
            file.write(data)
        beside.replace(path)
    except OSError as error:
        raise KeysError(f"{path} cannot be written: {error.strerror}") from None
