"""Certificates of a world: contents and issuing (X.509, RFC 5280).

The common name is the member's (a family's is hosts-*). Roles are organizational units (OU).
Alternative names hold restrictions as URIs (`minerva:kind/AFox`, `minerva:event/eNear`,
`minerva:topic/scan`), and host names and addresses. Keys are ECDSA P-256, signatures use SHA-256.
"""

from __future__ import annotations

import ipaddress
import socket
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Final

from minerva_bus.errors import KeysError
from minerva_bus.security.credentials import SERVERS, Rights
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
