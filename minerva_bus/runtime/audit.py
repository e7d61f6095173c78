"""Audit of the messages that Zenoh drops in a secured world, read from Zenoh's log.

Zenoh reports drops only in its log. At level `trace`, its access control logs a ruling for each
message: sender, operation and key. If the message is dropped, a second line follows from the same
thread for the same link:

    ... rx-0 ThreadId(06) demux{zid=ab src=south:0:client/cd:4}: zenoh::...::access_control: cd on
        Interface(lo)+CertCommonName(sensor)+Transport(Tls)+cd is unauthorized to Put (ingress) on
        minerva/w/tick
    ... rx-0 ThreadId(06) demux{zid=ab src=south:0:client/cd:4}: zenoh::...::interceptor: Msg
        intercepted!

Neither line suffices alone: the first is also written for messages that are not sent yet, and the
second has no key. If the first permits a reading, the low-pass filter dropped it for its size.

A key may contain any character, including line ends, so a sender could forge lines that accuse
others. But Zenoh escapes the escape character. Its colour sequences cannot be forged, so every
pattern here includes them.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final, TypeVar

from minerva_bus.runtime.admission_rules import STRANGERS

_Kept = TypeVar("_Kept")

LEVELS: Final = "zenoh::net::routing::interceptor=trace,zenoh::net::primitives::demux=debug"
"""The second adds to each line the link by which a message arrived."""

POLL_SECONDS: Final = 0.02
TOO_LARGE: Final = "published too large a message on"
OPERATIONS: Final = {
    b"Put": "published on",
    b"Delete": "deleted",
    b"Declare Subscriber": "subscribed to",
    b"Declare Queryable": "declared a queryable on",
    b"Query": "queried",
    b"Reply": "replied on",
    b"Liveliness Token": "declared a liveliness token on",
    b"Liveliness Query": "queried liveliness of",
    b"Declare Liveliness Subscriber": "queried liveliness of",
}
"""Operations by Zenoh's name, as log lines state them before the key."""

MAX_KEY_LENGTH: Final = 200
MAX_LINKS: Final = 1000
_ENTRY: Final = b"\x1b[2m"
_OURS: Final = (b"\x1b[2mzenoh::net::routing::interceptor", b"\x1b[2mzenoh::net::primitives::demux")
_SAYS: Final = b"\x1b[0m\x1b[2m:\x1b[0m "
_RULED: Final = _OURS[0] + b"::access_control" + _SAYS
_DROPPED: Final = _OURS[0] + _SAYS + b"Msg intercepted!"
_ON: Final = b"gress) on "
_RULING: Final = re.compile(
    rb"(?:Using cached result: )?(?P<link>[0-9a-f]+)(?: on (?P<subject>\S+))?"
    rb" is (?P<un>un)?authorized to (?P<deed>[A-Z][A-Za-z/ ]*) \((?P<flow>in|e)"
)
_NAME: Final = re.compile(rb"CertCommonName\(([^)]*)\)")
_OF_ZENOH: Final = frozenset({b"Declare Subscriber", b"Declare Queryable"})


@dataclass(frozen=True, slots=True)
class Denied:
    """A dropped message: sender, operation in words, and key."""

    sender: str
    operation: str
    key: str


@dataclass(frozen=True, slots=True)
class Denials:
    """Recent drops by sender, operation and kind of key: first occurrence and count."""

    times: Sequence[tuple[Denied, int]]


@dataclass(frozen=True, slots=True)
class Ruling:
    """A ruling of the access control, without the key.

    `name`: common name of the link's certificate, empty for a process of this machine, None if the
    line has none. `described`: the operation in words, if a drop that follows is the sender's;
    empty for outgoing messages, and for those that something else drops.
    """

    link: bytes
    name: str | None
    operation: bytes
    described: str


@lru_cache(MAX_LINKS)
def read_ruling(text: bytes) -> Ruling | None:
    """The ruling in a line of the access control, which ends before the key; None for others."""
    match = _RULING.fullmatch(text)
    if match is None:
        return None
    subject, operation, name = match["subject"], match["deed"], None
    if subject is not None:
        named = _NAME.search(subject)
        name = named[1].decode(errors="replace") if named else ""
    if match["un"]:
        described = OPERATIONS.get(operation, "")
    else:
        # Permitted by the rules, so only the low-pass filter for readings can have dropped it.
        described = TOO_LARGE if operation == b"Put" else ""
    return Ruling(match["link"], name, operation, described if match["flow"] == b"in" else "")


def _shown(key: str) -> str:
    """A key as one line: characters that cannot be printed are replaced."""
    return "".join([letter if letter.isprintable() else "?" for letter in key])


class Audit:
    """Finds dropped messages in the log and passes them to `notify`, batch by batch.

    `kind` maps a key to its purpose: there may be any number of keys, so drops are counted by kind.
    """

    def __init__(self, notify: Callable[[Denials], None], kind: Callable[[str], str]) -> None:
        self._notify = notify
        self._kind = kind
        self._ruled: dict[bytes, tuple[Ruling, bytes]] = {}
        self._names: dict[bytes, str] = {}
        self._times: dict[tuple[str, str, str], tuple[Denied, int]] = {}
        self._is_audit = False

    def read(self, lines: bytes) -> bytes:
        """Process the lines about drops; returns all other lines."""
        rest = list[bytes]()
        first, *others = lines.removesuffix(b"\n").split(b"\n" + _ENTRY)
        if first.startswith(_ENTRY):
            others.insert(0, first.removeprefix(_ENTRY))
        elif not self._is_audit:  # It continues the last entry of the previous batch.
            rest.append(first + b"\n")
        for entry in others:
            self._is_audit = self._takes(entry)
            if not self._is_audit:
                rest.append(_ENTRY + entry + b"\n")
        if self._times:
            self._notify(Denials(list(self._times.values())))
            self._times.clear()
        return b"".join(rest)

    def _takes(self, entry: bytes) -> bool:
        """Process an entry of the log; returns whether it belongs to the audit."""
        if entry.endswith(_DROPPED):
            # A ruling explains one drop only; a later drop without a ruling has another cause.
            ruled = self._ruled.pop(_place(entry.removesuffix(_DROPPED)), None)
            if ruled is not None and ruled[0].described:
                self._count(*ruled)
            return True
        before, mark, rest = entry.partition(_RULED)
        if mark:
            self._keep_ruling(_place(before), rest)
            return True
        return any(module in entry for module in _OURS)

    def _keep_ruling(self, place: bytes, rest: bytes) -> None:
        text, _, key = rest.partition(_ON)
        ruling = read_ruling(text)
        if ruling is None:
            # The earlier ruling does not explain the next drop at this place.
            self._ruled.pop(place, None)
            return
        _keep(self._ruled, place, (ruling, key[:MAX_KEY_LENGTH]))
        if ruling.name is not None:
            _keep(self._names, ruling.link, ruling.name)

    def _count(self, ruling: Ruling, key: bytes) -> None:
        """Count a drop of a member; declarations of Zenoh's own session do not count."""
        # Cached rulings name the link only; an earlier line had its certificate.
        name = self._names.get(ruling.link, STRANGERS)
        # An empty name is a process of this machine, which has all rights.
        if not name or (
            ruling.operation in _OF_ZENOH and key.startswith(b"@/" + ruling.link + b"/")
        ):
            return
        text = key.decode(errors="replace")
        group = name, ruling.described, self._kind(text)
        first, times = self._times.get(group, (None, 0))
        self._times[group] = first or Denied(name, ruling.described, _shown(text)), times + 1


def _place(before: bytes) -> bytes:
    """Thread and link of an entry, from the part before its text."""
    return before.partition(b"\x1b[0m ")[2]


def _keep(kept: dict[bytes, _Kept], key: bytes, value: _Kept) -> None:
    """Set an entry; beyond MAX_LINKS entries the oldest is removed."""
    if key not in kept and len(kept) >= MAX_LINKS:
        del kept[next(iter(kept))]
    kept[key] = value
