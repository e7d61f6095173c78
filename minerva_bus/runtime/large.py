"""Large messages of members: decoded beside the frames, one at a time, so that these go on."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from minerva_bus.errors import ProtocolError, SceneError
from minerva_bus.frame import messages as m
from minerva_bus.runtime.system import System
from minerva_bus.wire.codec import Decoder

LARGE: Final = 32 * 1024
"""Bytes from which on a message is decoded in a thread of its own."""

MAX_BEHIND: Final = 4
"""Large messages of one member that may wait: a frame asks for one at a time."""


@dataclass(frozen=True, slots=True)
class Letter:
    """What a member has said, and in which of its lives: how often it had joined."""

    member: str
    life: int
    body: bytes


@dataclass(frozen=True, slots=True)
class Opened:
    """A letter that is decoded: its message, or what is wrong with it. It took so many seconds."""

    letter: Letter
    message: m.FromMember | None
    problem: str
    seconds: float


class LargeMessages:
    """Opens letters; `put` hands an `Opened` over, from another thread, to who calls `taken`.

    What a member says behind a large message has to wait for it, too: `behind` says how much of it
    waits. Members take turns.
    """

    def __init__(self, decoder: Decoder, system: System, put: Callable[[Opened], None]) -> None:
        self._decoder = decoder
        self._system = system
        self._put = put
        self._waiting: dict[str, deque[Letter]] = {}
        self._busy = ""

    def behind(self, member: str) -> int:
        """How many messages of a member wait, or are being decoded."""
        return len(self._waiting.get(member, ()))

    def add(self, letter: Letter) -> None:
        """Have a letter opened when it is its turn."""
        self._waiting.setdefault(letter.member, deque()).append(letter)
        if not self._busy:
            self._begin(letter.member)

    def taken(self, opened: Opened) -> None:
        """One has been handed over: the next one may be opened, another member's if there is."""
        member = opened.letter.member
        waiting = self._waiting.pop(member)
        waiting.popleft()
        if waiting:
            self._waiting[member] = waiting
        self._busy = ""
        if self._waiting:
            self._begin(next(iter(self._waiting)))

    def _begin(self, member: str) -> None:
        letter, self._busy = self._waiting[member][0], member
        self._system.aside(lambda: self._put(self._opened(letter)))

    def _opened(self, letter: Letter) -> Opened:
        began = self._system.monotonic()
        message, problem = None, ""
        try:
            message = self._decoder.from_member(letter.member, letter.body)
        except (ProtocolError, SceneError) as error:
            problem = str(error)
        return Opened(letter, message, problem, self._system.monotonic() - began)
