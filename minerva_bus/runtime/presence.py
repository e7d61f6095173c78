"""Presence of members and coordinators, read from samples of their liveliness tokens."""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false
from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import islice
from threading import Lock
from typing import Final, TypeAlias

import zenoh

from minerva_bus.frame import stimuli as s
from minerva_bus.runtime.admission_rules import STRANGERS
from minerva_bus.wire.keys import COORDINATOR, MAX_NAME, last_part

HERE: Final = zenoh.SampleKind.PUT
GONE: Final = zenoh.SampleKind.DELETE

MAX_DIGITS: Final = 20
"""Digits of the highest epoch."""

LOOKED_AT: Final = 20
"""Names that are checked at once for one that has room for a change."""

Changes: TypeAlias = tuple[type[s.Appeared] | type[s.Vanished], ...]
_APPEARED: Final[Changes] = (s.Appeared,)
_VANISHED: Final[Changes] = (s.Vanished,)


@dataclass(frozen=True, slots=True)
class TokensChanged:
    """Tokens of members have changed: take one of the changes."""


class TokenChanges:
    """Changes of the members' tokens until the main thread takes them: the latest of each name.

    A token comes and goes as fast as its link allows, tens of thousands of times a second. So what
    waits is bounded by the number of names: a member that has vanished and appeared again is a new
    process, but one that has vanished again before it was taken has never been here. At most
    `most` names of guests wait. The changes of names for which `takes_part` is true come first.

    `put` requests a `take` by a `TokensChanged`; it is called in threads of Zenoh, as `note` is.
    """

    def __init__(
        self, takes_part: Callable[[str], bool], most: int, put: Callable[[TokensChanged], None]
    ) -> None:
        self._takes_part = takes_part
        self._most = most
        self._put = put
        self._lock = Lock()
        self._first: dict[str, Changes] = {}
        self._guests: dict[str, Changes] = {}
        self._here: set[str] = set()
        self._left_out: Counter[str] = Counter()
        self._requested = False

    def note(self, sample: zenoh.Sample) -> None:
        """Note a change of a token; called in a thread of Zenoh."""
        # A longer name is invalid anyway, and may have 64 kB.
        name = str(sample.key_expr).rpartition("/")[2][: MAX_NAME + 1]
        if name == COORDINATOR:
            return
        # In one piece, because in a flood this runs 80,000 times a second.
        with self._lock:
            first = name in self._first or (name not in self._guests and self._takes_part(name))
            changed, here = self._first if first else self._guests, name in self._here
            before = changed.get(name, ())
            appeared = before[-1:] == _APPEARED
            if sample.kind == HERE:
                if first or before or len(changed) < self._most:
                    changed[name] = before if appeared else before + _APPEARED
                else:
                    self._left_out[STRANGERS] += 1
            else:
                if appeared:
                    # Unlimited names may come and go, so only those that are known count alone.
                    self._left_out[name if first or here else STRANGERS] += 1
                if here:
                    changed[name] = _VANISHED
                else:
                    changed.pop(name, None)
            if self._requested or not changed:
                return
            self._requested = True
        self._put(TokensChanged())

    def take(self, has_room: Callable[[str, bool], bool]) -> list[s.Appeared | s.Vanished]:
        """The changes of one name; nothing if none waits that `has_room`.

        `has_room` is called with a name and with whether it takes part.
        """
        with self._lock:
            for changed in (self._first, self._guests):
                for name in list(islice(changed, LOOKED_AT)):
                    changes = changed.pop(name)
                    if has_room(name, changed is self._first):
                        here = changes[-1] is s.Appeared
                        (self._here.add if here else self._here.discard)(name)
                        self._requested = bool(self)
                        return [change(name) for change in changes]
                    changed[name] = changes  # Behind the others, which may have room.
            # What waits without room is taken by the clock: a flood must not request it again.
            self._requested = bool(self)
        return []

    def __bool__(self) -> bool:
        return bool(self._first or self._guests)

    def forget(self, name: str) -> None:
        """Ignore the token of a name that was not admitted, until it appears again."""
        with self._lock:
            self._here.discard(name)

    def left_out(self) -> Mapping[str, int]:
        """The number of appearances by name that were left out since the last call."""
        with self._lock:
            left_out, self._left_out = self._left_out, Counter()
        return left_out


@dataclass(frozen=True, slots=True)
class Successor:
    """A coordinator of this epoch is running."""

    epoch: int


def successor(sample: zenoh.Sample, own: int) -> Successor | None:
    """The coordinator whose token appeared, if its epoch is above the own one."""
    epoch = last_part(str(sample.key_expr))
    there = sample.kind == HERE and epoch.isdecimal() and len(epoch) <= MAX_DIGITS
    return Successor(int(epoch)) if there and int(epoch) > own else None
