"""What Zenoh drops at a secured world's door, by its own log: who did what, on which key.

Zenoh drops without a word, but at the level `trace` its access control says of each message who
may do what with it, and one more line follows, from the same thread and for the same link, where
the message is dropped:

    ... rx-0 ThreadId(06) demux{zid=ab src=south:0:client/cd:4}: zenoh::...::access_control: cd on
        Interface(lo)+CertCommonName(sensor)+Transport(Tls)+cd is unauthorized to Put (ingress) on
        minerva/w/tick
    ... rx-0 ThreadId(06) demux{zid=ab src=south:0:client/cd:4}: zenoh::...::interceptor: Msg
        intercepted!

Neither suffices alone: the first is also written of what might come, the second has no key.
Where the first says that a reading may pass, the low-pass filter has dropped it for its size.

A key may hold any character, and the end of a line, too, so that whoever chooses one could write
lines that accuse others. But Zenoh writes the escape character as text: its own colours are what
nobody can forge, and so they are part of all that is looked for here.
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
"""The latter gives each line the link that a message has come by."""

POLL_SECONDS: Final = 0.02
TOO_LARGE: Final = "published too much at once on"
DEEDS: Final = {
    b"Put": "published on",
    b"Delete": "deleted",
    b"Declare Subscriber": "listened to",
    b"Declare Queryable": "offered to answer on",
    b"Query": "asked on",
    b"Reply": "answered on",
    b"Liveliness Token": "declared somebody alive by",
    b"Liveliness Query": "looked who is alive by",
    b"Declare Liveliness Subscriber": "looked who is alive by",
}
"""What somebody does, by Zenoh's name for it, as what is said before the key."""

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
    """Something of somebody was dropped: what the sender did, in words, and on which key."""

    sender: str
    deed: str
    key: str


@dataclass(frozen=True, slots=True)
class Denials:
    """What was dropped of late, by sender, deed and kind of key: its first, and how often."""

    times: Sequence[tuple[Denied, int]]


@dataclass(frozen=True, slots=True)
class Ruling:
    """What the access control says of a message, but for its key.

    `name` is whose certificate the link came by ("": it is of this machine; None: it does not say
    so); `done` what was done, in words, if the message is dropped then; empty where no member has
    done it: it is on its way out, or such that something else has dropped it.
    """

    link: bytes
    name: str | None
    deed: bytes
    done: str


@lru_cache(MAX_LINKS)
def read_ruling(text: bytes) -> Ruling | None:
    """A line of the access control, from where its own text begins to where the key does."""
    found = _RULING.fullmatch(text)
    if found is None:
        return None
    subject, deed, name = found["subject"], found["deed"], None
    if subject is not None:
        named = _NAME.search(subject)
        name = named[1].decode(errors="replace") if named else ""
    done = DEEDS.get(deed, "") if found["un"] else TOO_LARGE if deed == b"Put" else ""
    return Ruling(found["link"], name, deed, done if found["flow"] == b"in" else "")


def _shown(key: str) -> str:
    """A key on one line: its sender has chosen it."""
    return "".join([one if one.isprintable() else "?" for one in key])


class Audit:
    """Hears the log; `tell` is told what was dropped, of some lines at a time.

    `kind` is what a key is for: there may be any number of keys, and of each kind one is told.
    """

    def __init__(self, tell: Callable[[Denials], None], kind: Callable[[str], str]) -> None:
        self._tell = tell
        self._kind = kind
        self._ruled: dict[bytes, tuple[Ruling, bytes]] = {}
        self._names: dict[bytes, str] = {}
        self._times: dict[tuple[str, str, str], tuple[Denied, int]] = {}
        self._mine = False

    def hear(self, lines: bytes) -> bytes:
        """Take what is about the dropping; the rest of the lines is returned."""
        rest = list[bytes]()
        first, *others = lines.removesuffix(b"\n").split(b"\n" + _ENTRY)
        if first.startswith(_ENTRY):
            others.insert(0, first.removeprefix(_ENTRY))
        elif not self._mine:  # It goes on with what was heard before.
            rest.append(first + b"\n")
        for entry in others:
            self._mine = self._takes(entry)
            if not self._mine:
                rest.append(_ENTRY + entry + b"\n")
        if self._times:
            self._tell(Denials(list(self._times.values())))
            self._times.clear()
        return b"".join(rest)

    def _takes(self, entry: bytes) -> bool:
        """Count what an entry of the log says was dropped; whether it is of those for us."""
        if entry.endswith(_DROPPED):
            ruled = self._ruled.pop(_place(entry.removesuffix(_DROPPED)), None)
            if ruled is not None and ruled[0].done:
                self._count(*ruled)
            return True
        before, found, said = entry.partition(_RULED)
        if found:
            self._keep_ruling(_place(before), said)
            return True
        return any(one in entry for one in _OURS)

    def _keep_ruling(self, place: bytes, said: bytes) -> None:
        text, _, key = said.partition(_ON)
        ruling = read_ruling(text)
        if ruling is None:
            self._ruled.pop(place, None)
            return
        _keep(self._ruled, place, (ruling, key[:MAX_KEY_LENGTH]))
        if ruling.name is not None:
            _keep(self._names, ruling.link, ruling.name)

    def _count(self, ruling: Ruling, key: bytes) -> None:
        """Count it, if it is a member's: not what Zenoh declares of its own session by itself."""
        name = self._names.get(ruling.link, STRANGERS)
        if not name or (ruling.deed in _OF_ZENOH and key.startswith(b"@/" + ruling.link + b"/")):
            return
        text = key.decode(errors="replace")
        alike = name, ruling.done, self._kind(text)
        first, times = self._times.get(alike, (None, 0))
        self._times[alike] = first or Denied(name, ruling.done, _shown(text)), times + 1


def _place(before: bytes) -> bytes:
    """The thread, and the link whose message it reads, of what stands before an entry's text."""
    return before.partition(b"\x1b[0m ")[2]


def _keep(kept: dict[bytes, _Kept], key: bytes, value: _Kept) -> None:
    """Set it, and forget the eldest where there are very many."""
    if key not in kept and len(kept) >= MAX_LINKS:
        del kept[next(iter(kept))]
    kept[key] = value
