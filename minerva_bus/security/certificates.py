"""What the certificates of a world's keys say, and how they are made and read (X.509, RFC 5280).

Who somebody is stands in the common name (a family's is hosts-*), roles in OU, what it is
confined to in URIs `minerva:kind/AFox`, `minerva:event/eNear`, `minerva:topic/scan`, and where it
serves in host names and addresses, all three alternative names. Keys are ECDSA P-256, signatures
with SHA-256.
"""

from __future__ import annotations

import ipaddress
import socket
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Final

from minerva_bus.errors import KeysError
from minerva_bus.security.credentials import FAMILY, SERVERS, Rights

try:
    from cryptography import x509
    from cryptography.exceptions import InvalidSignature
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID
except ImportError:
    raise KeysError("keys need cryptography: pip install 'minerva-bus[tls]'") from None

DAYS: Final = 365
_SCHEME = "minerva"
_SKEW = timedelta(minutes=5)
"""Clocks of several machines may differ by so much."""

_HERE = ("localhost", "127.0.0.1", "::1")
_LONGEST = 365 * 7000


@dataclass(frozen=True, slots=True)
class Wanted:
    """What a new certificate shall say; `family`: it is for all whose names begin with its own."""

    roles: tuple[str, ...]
    hosts: tuple[str, ...] = ()
    kinds: tuple[str, ...] = ()
    events: tuple[str, ...] = ()
    topics: tuple[str, ...] = ()
    days: int = DAYS
    family: bool = False

    @property
    def serves(self) -> bool:
        """Whether others connect to it."""
        return not SERVERS.isdisjoint(self.roles)


@dataclass(frozen=True, slots=True)
class Issued:
    """A certificate of a folder: what it is for, where it may serve, from when until when."""

    rights: Rights
    hosts: tuple[str, ...]
    serial: int
    begins: datetime
    ends: datetime
    key: bool

    def state(self, now: datetime) -> str:
        """valid, revoked, expired, or not yet valid."""
        if self.rights.revoked:
            return "revoked"
        if now > self.ends:
            return "expired"
        return "valid" if now >= self.begins else "not yet valid"


@dataclass(frozen=True, slots=True)
class Authority:
    """Who signs: its certificate and its key."""

    certificate: x509.Certificate
    key: ec.EllipticCurvePrivateKey

    @property
    def ends(self) -> datetime:
        """Until when anything that it has signed is taken."""
        return self.certificate.not_valid_after_utc

    @staticmethod
    def new(now: datetime, days: int) -> Authority:
        """An authority that makes certificates of members and no other authorities."""
        key = ec.generate_private_key(ec.SECP256R1())
        name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "Minerva Bus authority")])
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
        """A certificate and its key, for a common name; it ends no later than the authority.

        Raises KeysError for what it cannot say.
        """
        key = ec.generate_private_key(ec.SECP256R1())
        subject, issuer = _subject(name, wanted), self.certificate.subject
        purposes = [ExtendedKeyUsageOID.CLIENT_AUTH]
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
        """The list of what counts no more, PEM."""
        builder = x509.CertificateRevocationListBuilder(self.certificate.subject, now, self.ends)
        for serial in sorted(serials):
            one = x509.RevokedCertificateBuilder(serial, now)
            builder = builder.add_revoked_certificate(one.build())
        made = builder.sign(self.key, hashes.SHA256())
        return made.public_bytes(serialization.Encoding.PEM)


# --- files ---


def key_pem(key: ec.EllipticCurvePrivateKey) -> bytes:
    """A key as PEM, not encrypted: Zenoh reads it."""
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
        key = serialization.load_pem_private_key(path.read_bytes(), None)
    except (OSError, ValueError, TypeError) as error:
        raise KeysError(
            f"{path} cannot be read: {error}; issue and revoke where the authority was made"
        ) from None
    if not isinstance(key, ec.EllipticCurvePrivateKey):
        raise KeysError(f"{path} is no key of an elliptic curve")
    return key


def read_certificate(path: Path) -> x509.Certificate:
    """A certificate. Raises KeysError."""
    try:
        return x509.load_pem_x509_certificate(path.read_bytes())
    except (OSError, ValueError) as error:
        raise KeysError(f"{path} is no certificate: {error}") from None


def read_revoked(path: Path, authority: x509.Certificate) -> frozenset[int]:
    """The serial numbers of what an authority has revoked. Raises KeysError."""
    key = authority.public_key()
    if not isinstance(key, ec.EllipticCurvePublicKey):
        raise KeysError(f"{path.parent} has an authority without a key of an elliptic curve")
    try:
        found = x509.load_pem_x509_crl(path.read_bytes())
        signed = found.is_signature_valid(key)
    except (OSError, ValueError, TypeError) as error:
        raise KeysError(f"{path} is no list of what was revoked: {error}") from None
    if not signed:
        raise KeysError(f"{path} is not of the authority beside it")
    return frozenset(one.serial_number for one in found)


def read_issued(path: Path, authority: x509.Certificate, revoked: frozenset[int]) -> Issued:
    """A member's certificate, if it is of this authority. Raises KeysError."""
    made = read_certificate(path)
    try:
        made.verify_directly_issued_by(authority)
    except (InvalidSignature, ValueError, TypeError):
        raise KeysError(f"{path} is not of the authority beside it: take it away") from None
    name = _texts(made.subject, NameOID.COMMON_NAME)
    if name not in ([path.stem], [path.stem + FAMILY]):
        raise KeysError(f"{path} is the certificate of {', '.join(name) or 'nobody'}")
    hosts, uris = _read_alternative_names(made)
    rights = Rights(
        name[0],
        frozenset(_texts(made.subject, NameOID.ORGANIZATIONAL_UNIT_NAME)),
        *(_confined(uris, what) for what in ("kind", "event", "topic")),
        revoked=made.serial_number in revoked,
    )
    key = path.with_suffix(".key").exists()
    begins, ends = made.not_valid_before_utc, made.not_valid_after_utc
    return Issued(rights, hosts, made.serial_number, begins, ends, key)


# --- parts ---


def _builder(
    subject: x509.Name,
    issuer: x509.Name,
    key: ec.EllipticCurvePublicKey,
    now: datetime,
    days: int,
    latest: datetime | None = None,
) -> x509.CertificateBuilder:
    ends = now + timedelta(days=min(days, _LONGEST))
    return x509.CertificateBuilder(
        issuer_name=issuer,
        subject_name=subject,
        public_key=key,
        serial_number=x509.random_serial_number(),
        not_valid_before=now - _SKEW,
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
    own = (*_HERE, socket.gethostname()) if wanted.serves else ()
    found = [_host(host) for host in dict.fromkeys([*wanted.hosts, *own])]
    for what, names in (("kind", wanted.kinds), ("event", wanted.events), ("topic", wanted.topics)):
        for one in sorted(set(names)):
            found.append(x509.UniformResourceIdentifier(f"{_SCHEME}:{what}/{_ascii(one)}"))
    return found


def _host(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        pass
    if not host or any(one in "/:" for one in host):
        raise KeysError(f"--host: {host!r} is no host's name or address (without a port)")
    return x509.DNSName(_ascii(host))


def _ascii(text: str) -> str:
    if not text.isascii() or not text.isprintable() or " " in text:
        raise KeysError(f"{text!r}: a certificate has names in plain letters, digits and signs")
    return text


def _texts(name: x509.Name, oid: x509.ObjectIdentifier) -> list[str]:
    return [str(one.value) for one in name.get_attributes_for_oid(oid)]


def _read_alternative_names(made: x509.Certificate) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Hosts, and URIs."""
    try:
        found = made.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return (), ()
    names = found.get_values_for_type(x509.DNSName)
    addresses = [str(one) for one in found.get_values_for_type(x509.IPAddress)]
    return (*names, *addresses), tuple(found.get_values_for_type(x509.UniformResourceIdentifier))


def _confined(uris: Iterable[str], what: str) -> frozenset[str]:
    start = f"{_SCHEME}:{what}/"
    return frozenset(one.removeprefix(start) for one in uris if one.startswith(start))


def now() -> datetime:
    """What time it is."""
    return datetime.now(UTC)
