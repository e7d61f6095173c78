"""Certificates, keys and revocation lists as PEM files: writing, reading and checks.

certificates.py describes their contents.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from minerva_bus.errors import KeysError
from minerva_bus.input_files import read_bytes
from minerva_bus.outputs import is_stream
from minerva_bus.security.certificates import SCHEME, Issued
from minerva_bus.security.credentials import FAMILY, Rights
from minerva_bus.wording import install

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
