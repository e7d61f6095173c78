"""A certificate authority in a folder, for the members of a world.

    ca.pem, ca.key        the authority; its key is only needed to issue and to revoke
    crl.pem               the certificate revocation list
    NAME.pem, NAME.key    certificate and key of the member NAME, or of the family NAME-*
    NAME.key.new          a key whose certificate is being written, see `issue`

New folders have the mode 0700, keys 0600.
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
    check_pair,
    key_pem,
    now,
    read_certificate,
    read_issued,
    read_key,
    read_revoked,
    write_file,
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
_STAGED: Final = "key.new"


class KeyFolder:
    """The keys in a folder. `at` replaces the current time, for tests."""

    def __init__(self, folder: Path, at: datetime | None = None) -> None:
        self.folder = folder
        self.now = at or now()

    # --- issuing and revoking ---

    def init(self, hosts: Iterable[str] = (), days: int = AUTHORITY_DAYS) -> Issued:
        """Create the authority and the coordinator's certificate. Raises KeysError."""
        if self._has(AUTHORITY):
            raise KeysError(f"{self.folder} has an authority already (minerva keys list)")
        if days < 1:
            raise KeysError(f"--days must be a whole number from 1, not {days}")
        made, wanted = Authority.new(self.now, days), Wanted((HUB,), tuple(hosts))
        # Fails for invalid hosts before any file exists.
        certificate, key = made.issue(COORDINATOR, wanted, self.now)
        try:
            self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        except OSError as error:
            raise KeysError(f"{self.folder}: {error.strerror}") from None
        # ca.pem is written last, because its presence means that the folder is complete. Without
        # it, the next `init` replaces everything else; crl.pem, the first one, shows that an
        # `init` has written it.
        if not self._has(REVOKED):
            for name in (AUTHORITY, COORDINATOR):
                self._check_free(name)
        write_file(self._path(REVOKED, "pem"), made.revocations((), self.now), 0o644)
        write_file(self._path(AUTHORITY, "key"), key_pem(made.key), 0o600)
        write_file(self._path(COORDINATOR, "key"), key_pem(key), 0o600)
        write_file(self._path(COORDINATOR, "pem"), certificate_pem(certificate), 0o644)
        write_file(self._path(AUTHORITY, "pem"), certificate_pem(made.certificate), 0o644)
        return self.issued()[COORDINATOR]

    def issue(self, name: str, wanted: Wanted, *, renew: bool = False) -> Issued:
        """Issue a certificate with its key; `renew` replaces an existing one. Raises KeysError."""
        check_wanted(name, wanted)
        common, issued = name + FAMILY * wanted.family, self.issued()
        there = issued.get(name)
        # Access rules contain names only: a new certificate of this name would admit the
        # holder of the revoked one again.
        if there is not None and there.rights.revoked:
            raise KeysError(
                f"{name} was revoked, and its name cannot be used again; choose another name"
            )
        if there is not None and not renew:
            raise KeysError(
                f"{name} has a certificate until {there.ends:%Y-%m-%d}; --renew replaces it"
            )
        if there is not None and there.rights.name != common:
            given = "with" if family_start(there.rights.name) else "without"
            raise KeysError(f"{there.rights.name} is renewed {given} --family")
        if there is None:
            self._check_free(name)
            check_case(name, (*issued, AUTHORITY, REVOKED, COORDINATOR))
        # A name in two certificates would have two sets of rights.
        others = [other.rights.name for other in issued.values() if other is not there]
        check_alone(common, others, "choose another name")
        certificate, key = self._authority().issue(common, wanted, self.now)
        # Two files cannot change at once. The new key is stored beside the former pair, the
        # certificate commits the change, and the next reader, here `issued`, completes it.
        write_file(self._path(name, _STAGED), key_pem(key), 0o600)
        write_file(self._path(name, "pem"), certificate_pem(certificate), 0o644)
        return self.issued()[name]

    def revoke(self, name: str) -> Issued:
        """Add a certificate to the revocation list. Raises KeysError."""
        issued = self._named(name)
        if issued.rights.revoked:
            raise KeysError(f"{name} has been revoked already")
        authority, path = self._authority(), self._path(REVOKED, "pem")
        # The former list is verified first: a damaged one must not be replaced by a shorter one.
        serials = read_revoked(path, authority.certificate) | {issued.serial}
        write_file(path, authority.revocations(serials, self.now), 0o644)
        return self._named(name)

    # --- reading ---

    def issued(self) -> Mapping[str, Issued]:
        """All certificates of the folder except the authority's, by file. Raises KeysError."""
        if not self._has(AUTHORITY):
            raise KeysError(
                f"{self.folder} has no authority (ca.pem); create one with minerva keys init, or"
                " copy it together with the keys"
            )
        authority, revoked = read_certificate(self._path(AUTHORITY, "pem")), frozenset[int]()
        if self._has(REVOKED):  # Only the world needs the list; members may lack it.
            revoked = read_revoked(self._path(REVOKED, "pem"), authority)
        files = sorted(self.folder.glob("*.pem"))
        members = [file for file in files if file.stem not in (AUTHORITY, REVOKED)]
        for file in members:
            self._complete(file.stem)
        return {file.stem: read_issued(file, authority, revoked) for file in members}

    def rights(self) -> Mapping[str, Rights]:
        """The rights by common name, including revoked ones.

        Raises KeysError, also without a revocation list and for overlapping names.
        """
        # For the coordinator a missing list is an error, not an empty list.
        if not self._has(REVOKED):
            raise KeysError(f"{self.folder} lacks crl.pem: without it, revoked members could join")
        rights = {issued.rights.name: issued.rights for issued in self.issued().values()}
        valid = [name for name, holder in rights.items() if not holder.revoked]
        for place, name in enumerate(valid):
            check_alone(name, valid[:place], "revoke one of them")
        return rights

    def credentials(self, name: str = "", bearer: str = "") -> Credentials:
        """Credentials of the member `name`; without one, of the certificate's name.

        `bearer` names the certificate; by default that of `name` or its family, or the only one
        whose key is in the folder. A family's member without a name is named after its process id.
        Raises KeysError if there is no such certificate, or it is not valid.
        """
        bearer = bearer or (self._bearer(name) if name else self._only())
        issued, key = self._named(bearer), self._path(bearer, "key")
        if not issued.key:
            raise KeysError(f"{key} is missing: the key to {bearer}.pem")
        self._check_valid(bearer, issued)
        start, pem = family_start(issued.rights.name), self._path(bearer, "pem")
        if start and not (name or start).startswith(start):
            raise KeysError(
                f"{pem} is for the family {start}*, not for {name}; use --name {start}{name}"
            )
        check_pair(pem, key)
        own = (name or f"{start}{os.getpid()}") if start else bearer
        return Credentials(own, self._path(AUTHORITY, "pem"), pem, key, issued.rights.roles)

    def stamp(self) -> tuple[tuple[str, int], ...]:
        """A value that changes when a certificate is issued or revoked. Raises OSError."""
        files = sorted(self.folder.glob("*.pem"))
        return tuple([(file.name, file.stat().st_mtime_ns) for file in files])

    # --- parts ---

    def _complete(self, name: str) -> None:
        """Move the staged key of a certificate into place. Raises KeysError if it cannot."""
        staged = self._path(name, _STAGED)
        if not staged.exists():
            return
        try:
            public = read_key(staged).public_key()
        except KeysError:
            return  # Another process has just moved it, or only its owner may read it.
        # A key of another certificate is left over from an `issue` without a commit.
        if public != read_certificate(self._path(name, "pem")).public_key():
            return
        try:
            staged.replace(self._path(name, "key"))
        except FileNotFoundError:
            return  # Another process has moved it.
        except OSError as error:
            raise KeysError(
                f"{staged} is the key to {name}.pem and cannot be renamed to {name}.key:"
                f" {error.strerror}; rename it"
            ) from None

    def _has(self, name: str) -> bool:
        """Whether the folder has a certificate or list of this name.

        Raises KeysError if the folder cannot be read: that is not the same problem as a missing
        certificate.
        """
        try:
            return self._path(name, "pem").exists()
        except OSError as error:
            raise KeysError(
                f"{self.folder} cannot be read: {error.strerror}; the process needs the right to"
                " search the folder and to read its files"
            ) from None

    def _check_free(self, name: str) -> None:
        """Raises KeysError if there is a key without its certificate, made by something else."""
        key = self._path(name, "key")
        if key.is_symlink() or key.exists():
            raise KeysError(
                f"{key} exists, but not {name}.pem; move the key away, or choose another name or"
                " folder"
            )

    def _path(self, name: str, kind: str) -> Path:
        return self.folder / f"{name}.{kind}"

    def _authority(self) -> Authority:
        certificate = read_certificate(self._path(AUTHORITY, "pem"))
        authority = Authority(certificate, read_key(self._path(AUTHORITY, "key")))
        if self.now > authority.ends:
            raise KeysError(
                f"the authority of {self.folder} expired on {authority.ends:%Y-%m-%d}, and all"
                " certificates with it; create another with minerva keys init --dir NEW"
            )
        return authority

    def _check_valid(self, bearer: str, issued: Issued) -> None:
        state = issued.state(self.now)
        if state == "expired":
            family = " --family" if family_start(issued.rights.name) else ""
            raise KeysError(
                f"the certificate of {bearer} expired on {issued.ends:%Y-%m-%d}; renew it with"
                f" minerva keys issue {bearer} --renew{family}"
            )
        if state != "valid":
            raise KeysError(f"the certificate of {bearer} is {state}; ask the owner of ca.key")

    def _bearer(self, member: str) -> str:
        """The file of a member's certificate, its own or its family's."""
        files = self.issued().items()
        return next((file for file, made in files if covers(made.rights.name, member)), member)

    def _only(self) -> str:
        own = [name for name, issued in self.issued().items() if issued.key]
        if len(own) != 1:
            raise KeysError(
                f"{self.folder} has {len(own)} keys ({', '.join(own) or 'none'}), expected one;"
                f" choose with --keys {self.folder}/NAME.pem"
            )
        return own[0]

    def _named(self, name: str) -> Issued:
        issued, name = self.issued(), name.removesuffix(FAMILY)
        if name not in issued:
            there = ", ".join(made.rights.name for made in issued.values()) or "none"
            hint = nearest(name, list(issued), f"there are {there}")
            raise KeysError(f"{self.folder} has no certificate of {name!r}{hint}")
        return issued[name]


AUTHORITY: Final = "ca"
REVOKED: Final = "crl"


def check_wanted(name: str, wanted: Wanted) -> None:
    """Raises KeysError if a certificate cannot have this name with these rights."""
    try:
        checked_name(name, "a certificate")
    except MisuseError as error:
        raise KeysError(str(error)) from None
    for role in wanted.roles:
        if role not in ROLES:
            hint = nearest(role, list(ROLES), f"there are {', '.join(ROLES)}")
            raise KeysError(f"--role: there is no role {role!r}{hint}")
    if not wanted.roles:
        raise KeysError(f"--role is missing; roles are {', '.join(ROLES)}")
    if (name == COORDINATOR) != (HUB in wanted.roles) or name in (AUTHORITY, REVOKED):
        raise KeysError(f"{name} cannot be {', '.join(wanted.roles)}: choose another name")
    if wanted.family and not SERVERS.isdisjoint(wanted.roles):
        raise KeysError(f"{', '.join(wanted.roles)}: this role cannot have a family")
    if wanted.family and not is_name(f"{name}-a"):
        raise KeysError(f"{name} is too long for a family, whose members' names begin with it")
    if wanted.days < 1:
        raise KeysError(f"--days must be a whole number from 1, not {wanted.days}")


def check_alone(name: str, others: Iterable[str], otherwise: str) -> None:
    """Raises KeysError if two certificates are valid for the same member."""
    for other in others:
        if overlap(name, other):
            raise KeysError(f"{name} and {other} have names in common: {otherwise}")


def check_case(name: str, others: Iterable[str]) -> None:
    """Raises KeysError if a file system without letter case takes two names for the same."""
    for other in others:
        if other != name and other.casefold() == name.casefold():
            raise KeysError(
                f"{name} and {other} differ in the case of letters only, and some file systems take"
                " their files for the same: choose another name"
            )
