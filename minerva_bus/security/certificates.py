"""Certificates of a world: contents, issuing (X.509, RFC 5280), and their PEM files.

The common name is the member's (a family's is hosts-*). Roles are organizational units (OU).
Alternative names hold restrictions as URIs (`minerva:kind/AFox`, `minerva:event/eNear`,
`minerva:topic/scan`), and host names and addresses. Keys are ECDSA P-256, signatures use SHA-256.
"""

from __future__ import annotations

import ipaddress
import os
import socket
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Final

from minerva_bus.errors import KeysError
from minerva_bus.files import is_stream, read_bytes
from minerva_bus.security.credentials import FAMILY, SERVERS, Rights
from minerva_bus.wording import install

try:
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID
except ImportError:
    raise KeysError(f"keys need cryptography: {install('tls')}") from None

DAYS: Final = 365
SCHEME = "minerva"
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


def now() -> datetime:
    """The current time."""
    return datetime.now(UTC)


try:
    from cryptography import x509
    from cryptography.exceptions import InvalidSignature
    from cryptography.hazmat.primitives import serialization
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.x509.oid import NameOID
except ImportError:
    raise KeysError(f"keys need cryptography: {install('tls')}") from None


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
