"""A certificate authority in a folder, for the members of a world.

    ca.pem, ca.key        the authority; its key is only needed to issue and to revoke
    crl.pem               the certificate revocation list
    NAME.pem, NAME.key    certificate and key of the member NAME, or of the family NAME-*
    NAME.key.new          a key whose certificate is being written, see `issue`

New folders have the mode 0700, keys 0600.
"""

from __future__ import annotations

import ipaddress
import os
import socket
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import Final

from minerva_bus.errors import KeysError, MisuseError, nearest
from minerva_bus.security.credentials import FAMILY, HUB, ROLES, SERVERS, family_start
from minerva_bus.wire.keys import COORDINATOR, checked_name, is_name
from minerva_bus.wording import install
from minerva_certificates.key_folder import (
    AUTHORITY,
    REVOKED,
    SCHEME,
    STAGED,
    Issued,
    KeyFolder,
    check_alone,
    read_certificate,
    read_key,
    read_revoked,
)

try:
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID
except ImportError:
    raise KeysError(f"keys need cryptography: {install('tls')}") from None

AUTHORITY_DAYS: Final = 3650
DAYS: Final = 365
_SKEW = timedelta(minutes=5)
"""Allowed difference between the clocks of machines."""

_HERE = ("localhost", "127.0.0.1", "::1")
_MAX_DAYS = 365 * 7000
"""Beyond this, the end would be after the year 9999, which datetime cannot represent."""


@dataclass(frozen=True, slots=True)
class Wanted:
    """Contents of a new certificate; `family`: it is valid for all names that begin with it."""

    roles: tuple[str, ...]
    hosts: tuple[str, ...] = ()
    kinds: tuple[str, ...] = ()
    events: tuple[str, ...] = ()
    topics: tuple[str, ...] = ()
    days: int = DAYS
    family: bool = False

    @property
    def serves(self) -> bool:
        """Whether its holder accepts connections."""
        return not SERVERS.isdisjoint(self.roles)


@dataclass(frozen=True, slots=True)
class Authority:
    """A certificate authority: its certificate and its key."""

    certificate: x509.Certificate
    key: ec.EllipticCurvePrivateKey

    @property
    def ends(self) -> datetime:
        """The expiry date of the authority and everything that it signed."""
        return self.certificate.not_valid_after_utc

    @staticmethod
    def new(now: datetime, days: int) -> Authority:
        """An authority that can issue certificates of members, but none of other authorities."""
        key = ec.generate_private_key(ec.SECP256R1())
        name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "Minerva Bus authority")])
        # The authority's key signs certificates and lists only, never a connection.
        usage = _usage(key_cert_sign=True, crl_sign=True)
        made = (
            _builder(name, name, key.public_key(), now, days)
            .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
            .add_extension(usage, critical=True)
            .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), False)
            .sign(key, hashes.SHA256())
        )
        return Authority(made, key)

    def issue(
        self, name: str, wanted: Wanted, now: datetime
    ) -> tuple[x509.Certificate, ec.EllipticCurvePrivateKey]:
        """A certificate and its key; it expires with the authority at the latest.

        Raises KeysError for contents that a certificate cannot have.
        """
        key = ec.generate_private_key(ec.SECP256R1())
        subject, issuer = _subject(name, wanted), self.certificate.subject
        purposes = [ExtendedKeyUsageOID.CLIENT_AUTH]
        # Clients reject a server whose certificate lacks this purpose, so no
        # member can pose as the coordinator.
        if wanted.serves:
            purposes.append(ExtendedKeyUsageOID.SERVER_AUTH)
        signer = x509.AuthorityKeyIdentifier.from_issuer_public_key(self.key.public_key())
        builder = (
            _builder(subject, issuer, key.public_key(), now, wanted.days, self.ends)
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .add_extension(_usage(digital_signature=True), critical=True)
            .add_extension(x509.ExtendedKeyUsage(purposes), critical=False)
            .add_extension(signer, critical=False)
        )
        names = _alternative_names(wanted)
        if names:
            builder = builder.add_extension(x509.SubjectAlternativeName(names), critical=False)
        return builder.sign(self.key, hashes.SHA256()), key

    def revocations(self, serials: Iterable[int], now: datetime) -> bytes:
        """The certificate revocation list, as PEM."""
        # Valid as long as the authority, so that a list without changes need not be renewed.
        builder = x509.CertificateRevocationListBuilder(self.certificate.subject, now, self.ends)
        for serial in sorted(serials):
            revoked = x509.RevokedCertificateBuilder(serial, now).build()
            builder = builder.add_revoked_certificate(revoked)
        made = builder.sign(self.key, hashes.SHA256())
        return made.public_bytes(serialization.Encoding.PEM)


def _builder(
    subject: x509.Name,
    issuer: x509.Name,
    key: ec.EllipticCurvePublicKey,
    now: datetime,
    days: int,
    latest: datetime | None = None,
) -> x509.CertificateBuilder:
    ends = now + timedelta(days=min(days, _MAX_DAYS))
    return x509.CertificateBuilder(
        issuer_name=issuer,
        subject_name=subject,
        public_key=key,
        serial_number=x509.random_serial_number(),
        # Otherwise a machine whose clock is slightly slow would reject a new certificate.
        not_valid_before=now - _SKEW,
        # A certificate that outlives its authority cannot be verified.
        not_valid_after=ends if latest is None else min(ends, latest),
    )


def _usage(**true: bool) -> x509.KeyUsage:
    names = (
        "digital_signature", "content_commitment", "key_encipherment", "data_encipherment",
        "key_agreement", "key_cert_sign", "crl_sign", "encipher_only", "decipher_only",
    )  # fmt: skip
    return x509.KeyUsage(**{name: true.get(name, False) for name in names})


def _subject(name: str, wanted: Wanted) -> x509.Name:
    unit = NameOID.ORGANIZATIONAL_UNIT_NAME
    roles = [x509.NameAttribute(unit, role) for role in sorted(set(wanted.roles))]
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name), *roles])


def _alternative_names(wanted: Wanted) -> list[x509.GeneralName]:
    # Clients compare the host they connect to with these names.
    own = (*_HERE, socket.gethostname()) if wanted.serves else ()
    hosts = [_host(host) for host in dict.fromkeys([*wanted.hosts, *own])]
    limits = (("kind", wanted.kinds), ("event", wanted.events), ("topic", wanted.topics))
    uris = [
        x509.UniformResourceIdentifier(f"{SCHEME}:{what}/{_ascii(name)}")
        for what, names in limits
        for name in sorted(set(names))
    ]
    return [*hosts, *uris]


def _host(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        pass
    if not host or not {"/", ":"}.isdisjoint(host):
        raise KeysError(f"--host: {host!r} is not a host name or address (without a port)")
    return x509.DNSName(_ascii(host))


def _ascii(text: str) -> str:
    if not text.isascii() or not text.isprintable() or " " in text:
        raise KeysError(f"{text!r}: a certificate has names in plain letters, digits and signs")
    return text


def key_pem(key: ec.EllipticCurvePrivateKey) -> bytes:
    """A key as PEM, not encrypted, because Zenoh has to read it."""
    return key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )


def certificate_pem(certificate: x509.Certificate) -> bytes:
    """A certificate as PEM."""
    return certificate.public_bytes(serialization.Encoding.PEM)


def write_file(path: Path, data: bytes, mode: int) -> None:
    """Write a file atomically, with its mode from the first byte on. Raises KeysError."""
    beside = path.with_suffix(f".{os.getpid()}.new")
    try:
        # May be left from a killed process with the same id, which is always 1 in a container.
        beside.unlink(missing_ok=True)
        # O_EXCL, so that a link at this path is not followed.
        descriptor = os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
        with os.fdopen(descriptor, "wb") as file:
            file.write(data)
        beside.replace(path)
    except OSError as error:
        raise KeysError(f"{path} cannot be written: {error.strerror}") from None


class AuthorityFolder(KeyFolder):
    """The keys in a folder, with those that issue others."""

    def init(self, hosts: Iterable[str] = (), days: int = AUTHORITY_DAYS) -> Issued:
        """Create the authority and the coordinator's certificate. Raises KeysError."""
        if self.has(AUTHORITY):
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
        if not self.has(REVOKED):
            for name in (AUTHORITY, COORDINATOR):
                self._check_free(name)
        write_file(self.path(REVOKED, "pem"), made.revocations((), self.now), 0o644)
        write_file(self.path(AUTHORITY, "key"), key_pem(made.key), 0o600)
        write_file(self.path(COORDINATOR, "key"), key_pem(key), 0o600)
        write_file(self.path(COORDINATOR, "pem"), certificate_pem(certificate), 0o644)
        write_file(self.path(AUTHORITY, "pem"), certificate_pem(made.certificate), 0o644)
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
        write_file(self.path(name, STAGED), key_pem(key), 0o600)
        write_file(self.path(name, "pem"), certificate_pem(certificate), 0o644)
        return self.issued()[name]

    def revoke(self, name: str) -> Issued:
        """Add a certificate to the revocation list. Raises KeysError."""
        issued = self.named(name)
        if issued.rights.revoked:
            raise KeysError(f"{name} has been revoked already")
        authority, path = self._authority(), self.path(REVOKED, "pem")
        # The former list is verified first: a damaged one must not be replaced by a shorter one.
        serials = read_revoked(path, authority.certificate) | {issued.serial}
        write_file(path, authority.revocations(serials, self.now), 0o644)
        return self.named(name)

    def _check_free(self, name: str) -> None:
        """Raises KeysError if there is a key without its certificate, made by something else."""
        key = self.path(name, "key")
        if key.is_symlink() or key.exists():
            raise KeysError(
                f"{key} exists, but not {name}.pem; move the key away, or choose another name or"
                " folder"
            )

    def _authority(self) -> Authority:
        certificate = read_certificate(self.path(AUTHORITY, "pem"))
        authority = Authority(certificate, read_key(self.path(AUTHORITY, "key")))
        if self.now > authority.ends:
            raise KeysError(
                f"the authority of {self.folder} expired on {authority.ends:%Y-%m-%d}, and all"
                " certificates with it; create another with minerva keys init --dir NEW"
            )
        return authority


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


def check_case(name: str, others: Iterable[str]) -> None:
    """Raises KeysError if a file system without letter case takes two names for the same."""
    for other in others:
        if other != name and other.casefold() == name.casefold():
            raise KeysError(
                f"{name} and {other} differ in the case of letters only, and some file systems take"
                " their files for the same: choose another name"
            )
