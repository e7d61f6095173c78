"""Connections that Zenoh rejects during the handshake: only its log reports them."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

LEVELS: Final = "off,zenoh_link_tls=warn,zenoh_link_quic=warn"
_OF_LINKS: Final = (b" zenoh_link_tls::", b" zenoh_link_quic::")
_COLOURS: Final = re.compile(rb"\x1b\[[0-9;]*m")
NOTHING: Final = "only checked whether the port is open"
_REASONS: Final = (
    ("handshake eof", NOTHING),
    ("no certificate", "had no certificate"),
    ("expired", "had a certificate that has expired"),
    ("UnknownIssuer", "had a certificate of another authority"),
    ("BadSignature", "had a certificate of another authority"),
    ("DecryptError", "knew another authority than this world's"),
    ("UnknownCA", "knew another authority than this world's"),
    ("BadCertificate", "did not take this world's certificate"),
    ("corrupt message", "did not speak TLS"),
)


@dataclass(frozen=True, slots=True)
class RejectedConnection:
    """A rejected connection, with the reason."""

    reason: str


def rejections_in(notify: Callable[[RejectedConnection], None]) -> Callable[[bytes], bytes]:
    """A log reader: it reports rejected connections to `notify` and returns all other lines."""

    def hear(lines: bytes) -> bytes:
        return b"".join([line for line in lines.splitlines(keepends=True) if not rejected(line)])

    def rejected(line: bytes) -> bool:
        reason = reason_in(line)
        # Probes, such as `diagnosis.check_reachable`, connect without a
        # handshake; they are not attempts to join.
        if reason and reason != NOTHING:
            notify(RejectedConnection(reason))
        return bool(reason)

    return hear


def reason_in(line: bytes) -> str:
    """The reason of a rejection in a line of the log, or an empty string."""
    plain = _COLOURS.sub(b"", line)
    for mark in _OF_LINKS:
        _, separator, rest = plain.partition(mark)
        if separator:
            message = rest.decode(errors="replace").partition(": ")[2]
            known = [reason for sign, reason in _REASONS if sign in message]
            return known[0] if known else message.partition(". Hint")[0].strip()
    return ""
