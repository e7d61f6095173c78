"""Certificates of a world (X.509, RFC 5280) in a folder, as their holders read them.

    ca.pem                the authority
    crl.pem               the certificate revocation list
    NAME.pem, NAME.key    certificate and key of the member NAME, or of the family NAME-*
    NAME.key.new          a key whose certificate is being written

The common name is the member's (a family's is hosts-*). Roles are organizational units (OU).
Alternative names hold restrictions as URIs (`minerva:kind/AFox`, `minerva:event/eNear`,
`minerva:topic/scan`), and host names and addresses. Keys are ECDSA P-256, signatures use SHA-256.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from minerva_bus.errors import KeysError, nearest
from minerva_bus.files import is_stream, read_bytes
from minerva_bus.security.credentials import (
    FAMILY,
    Credentials,
    Rights,
    covers,
    family_start,
    overlap,
)
from minerva_bus.wording import install

try:
    from cryptography import x509
    from cryptography.exceptions import InvalidSignature
    from cryptography.hazmat.primitives import serialization
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.x509.oid import NameOID
except ImportError:
    raise KeysError(f"keys need cryptography: {install('tls')}") from None

SCHEME = "minerva"
AUTHORITY: Final = "ca"
REVOKED: Final = "crl"
STAGED: Final = "key.new"


@dataclass(frozen=True, slots=True)
class Issued:
    """A certificate in a folder: rights, hosts that it may serve at, and period of validity.

    `key`: whether its key is in the folder, too.
    """

    rights: Rights
    hosts: tuple[str, ...]
    serial: int
    begins: datetime
    ends: datetime
    key: bool

    def state(self, now: datetime) -> str:
        """One of: valid, revoked, expired, not yet valid."""
        if self.rights.revoked:
            return "revoked"
        if now > self.ends:
            return "expired"
        return "valid" if now >= self.begins else "not yet valid"


def now() -> datetime:
    """The current time."""
    return datetime.now(UTC)


def read_key(path: Path) -> ec.EllipticCurvePrivateKey:
    """The authority's key. Raises KeysError."""
    try:
        key = serialization.load_pem_private_key(_content(path), None)
    except (OSError, ValueError, TypeError) as error:
        raise KeysError(
            f"{path} cannot be read: {error}; issue and revoke where the authority was made"
        ) from None
    if not isinstance(key, ec.EllipticCurvePrivateKey):
        raise KeysError(f"{path} is not a key of an elliptic curve")
    return key


def read_certificate(path: Path) -> x509.Certificate:
    """A certificate. Raises KeysError."""
    try:
        return x509.load_pem_x509_certificate(_content(path))
    except (OSError, ValueError) as error:
        raise KeysError(f"{path} is not a certificate: {error}") from None


def check_pair(certificate: Path, key: Path) -> None:
    """Check that a key is that of a certificate. Raises KeysError."""
    otherwise = f"copy both files from where {certificate.stem} was issued"
    try:
        private = serialization.load_pem_private_key(_content(key), None)
    except (OSError, ValueError, TypeError) as error:
        raise KeysError(f"{key} cannot be read: {error}; {otherwise}") from None
    if private.public_key() != read_certificate(certificate).public_key():
        raise KeysError(f"{key} is not the key to {certificate}; {otherwise}")


def read_revoked(path: Path, authority: x509.Certificate) -> frozenset[int]:
    """The serial numbers of revoked certificates. Raises KeysError."""
    key = authority.public_key()
    if not isinstance(key, ec.EllipticCurvePublicKey):
        raise KeysError(f"{path.parent} has an authority without a key of an elliptic curve")
    try:
        revocations = x509.load_pem_x509_crl(_content(path))
        # Serial numbers are unique only per authority.
        signed = revocations.is_signature_valid(key)
    except (OSError, ValueError, TypeError) as error:
        raise KeysError(f"{path} is not a revocation list: {error}") from None
    if not signed:
        raise KeysError(f"{path} was not issued by the authority beside it: delete it")
    return frozenset(revoked.serial_number for revoked in revocations)


def read_issued(path: Path, authority: x509.Certificate, revoked: frozenset[int]) -> Issued:
    """A member's certificate. Raises KeysError if another authority issued it."""
    made = read_certificate(path)
    try:
        made.verify_directly_issued_by(authority)
    except (InvalidSignature, ValueError, TypeError):
        raise KeysError(f"{path} was not issued by the authority beside it: delete it") from None
    name = _texts(made.subject, NameOID.COMMON_NAME)
    # The folder is read by file names, so a copy under another name must not count.
    if name not in ([path.stem], [path.stem + FAMILY]):
        raise KeysError(f"{path} is the certificate of {', '.join(name) or 'nobody'}")
    hosts, uris = _read_alternative_names(made)
    rights = Rights(
        name[0],
        frozenset(_texts(made.subject, NameOID.ORGANIZATIONAL_UNIT_NAME)),
        *(_restricted(uris, what) for what in ("kind", "event", "topic")),
        revoked=made.serial_number in revoked,
    )
    key = path.with_suffix(".key").exists()
    begins, ends = made.not_valid_before_utc, made.not_valid_after_utc
    return Issued(rights, hosts, made.serial_number, begins, ends, key)


def _content(path: Path) -> bytes:
    if is_stream(path):
        raise ValueError("it is a pipe or device")
    return read_bytes(path)


def _texts(name: x509.Name, oid: x509.ObjectIdentifier) -> list[str]:
    return [str(attribute.value) for attribute in name.get_attributes_for_oid(oid)]


def _read_alternative_names(made: x509.Certificate) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The hosts and the URIs of a certificate."""
    try:
        alternative = made.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return (), ()
    names = alternative.get_values_for_type(x509.DNSName)
    addresses = map(str, alternative.get_values_for_type(x509.IPAddress))
    uris = alternative.get_values_for_type(x509.UniformResourceIdentifier)
    return (*names, *addresses), tuple(uris)


def _restricted(uris: Iterable[str], what: str) -> frozenset[str]:
    start = f"{SCHEME}:{what}/"
    return frozenset(uri.removeprefix(start) for uri in uris if uri.startswith(start))


class KeyFolder:
    """The keys in a folder. `at` replaces the current time, for tests."""

    def __init__(self, folder: Path, at: datetime | None = None) -> None:
        self.folder = folder
        self.now = at or now()

    def issued(self) -> Mapping[str, Issued]:
        """All certificates of the folder except the authority's, by file. Raises KeysError."""
        if not self.has(AUTHORITY):
            raise KeysError(
                f"{self.folder} has no authority (ca.pem); create one with minerva keys init, or"
                " copy it together with the keys"
            )
        authority, revoked = read_certificate(self.path(AUTHORITY, "pem")), frozenset[int]()
        if self.has(REVOKED):  # Only the world needs the list; members may lack it.
            revoked = read_revoked(self.path(REVOKED, "pem"), authority)
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
        if not self.has(REVOKED):
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
        issued, key = self.named(bearer), self.path(bearer, "key")
        if not issued.key:
            raise KeysError(f"{key} is missing: the key to {bearer}.pem")
        self._check_valid(bearer, issued)
        start, pem = family_start(issued.rights.name), self.path(bearer, "pem")
        if start and not (name or start).startswith(start):
            raise KeysError(
                f"{pem} is for the family {start}*, not for {name}; use --name {start}{name}"
            )
        check_pair(pem, key)
        own = (name or f"{start}{os.getpid()}") if start else bearer
        return Credentials(own, self.path(AUTHORITY, "pem"), pem, key, issued.rights.roles)

    def stamp(self) -> tuple[tuple[str, int], ...]:
        """A value that changes when a certificate is issued or revoked. Raises OSError."""
        files = sorted(self.folder.glob("*.pem"))
        return tuple([(file.name, file.stat().st_mtime_ns) for file in files])

    # --- parts ---

    def _complete(self, name: str) -> None:
        """Move the staged key of a certificate into place. Raises KeysError if it cannot."""
        staged = self.path(name, STAGED)
        if not staged.exists():
            return
        try:
            public = read_key(staged).public_key()
        except KeysError:
            return  # Another process has just moved it, or only its owner may read it.
        # A key of another certificate is left over from an `issue` without a commit.
        if public != read_certificate(self.path(name, "pem")).public_key():
            return
        try:
            staged.replace(self.path(name, "key"))
        except FileNotFoundError:
            return  # Another process has moved it.
        except OSError as error:
            raise KeysError(
                f"{staged} is the key to {name}.pem and cannot be renamed to {name}.key:"
                f" {error.strerror}; rename it"
            ) from None

    def has(self, name: str) -> bool:
        """Whether the folder has a certificate or list of this name.

        Raises KeysError if the folder cannot be read: that is not the same problem as a missing
        certificate.
        """
        try:
            return self.path(name, "pem").exists()
        except OSError as error:
            raise KeysError(
                f"{self.folder} cannot be read: {error.strerror}; the process needs the right to"
                " search the folder and to read its files"
            ) from None

    def path(self, name: str, kind: str) -> Path:
        return self.folder / f"{name}.{kind}"

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

    def named(self, name: str) -> Issued:
        issued, name = self.issued(), name.removesuffix(FAMILY)
        if name not in issued:
            there = ", ".join(made.rights.name for made in issued.values()) or "none"
            hint = nearest(name, list(issued), f"there are {there}")
            raise KeysError(f"{self.folder} has no certificate of {name!r}{hint}")
        return issued[name]


def check_alone(name: str, others: Iterable[str], otherwise: str) -> None:
    """Raises KeysError if two certificates are valid for the same member."""
    for other in others:
        if overlap(name, other):
            raise KeysError(f"{name} and {other} have names in common: {otherwise}")
