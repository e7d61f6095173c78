"""Large messages of members: decoded in a thread, one at a time, while the frames continue."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from minerva_bus.errors import ProtocolError, SceneError
from minerva_bus.frame import messages as m
from minerva_bus.runtime.system import System
from minerva_bus.wire.codec import Decoder
from minerva_bus.wire.message_limits import values_in

LARGE: Final = 32 * 1024
"""Bytes above which a message with many values is decoded in a thread."""

MANY_VALUES: Final = 1000
IN_COLUMNS: Final = 256 * 1024
"""Bytes above which one with few values is, too, since ids in a column are decoded one by one."""

MAX_BEHIND: Final = 4
"""Messages of one member that may wait for the thread: a frame asks for one at a time."""


def is_slow(body: bytes) -> bool:
    """Whether to decode a message in a thread.

    A new thread and its hand-over cost more than it takes to decode columns of this size.
    """
    if len(body) <= LARGE:
        return False
    return len(body) > IN_COLUMNS or values_in(body, MANY_VALUES) > MANY_VALUES


@dataclass(frozen=True, slots=True)
class LargeMessage:
    """The bytes of a member's message; `joins` counts how often the member has joined so far."""

    member: str
    joins: int
    body: bytes


@dataclass(frozen=True, slots=True)
class Decoded:
    """A large message after decoding, or None and its problem; decoding took `seconds`."""

    large: LargeMessage
    message: m.FromMember | None
    problem: str
    seconds: float


class LargeMessages:
    """Decodes large messages, alternating between members.

    `put` passes a `Decoded` from the thread to the main thread, which calls `taken`. A member's
    later messages, large or not, wait for its large ones, so that the order is kept.
    """

    def __init__(self, decoder: Decoder, system: System, put: Callable[[Decoded], None]) -> None:
        self._decoder = decoder
        self._system = system
        self._put = put
        self._waiting: dict[str, deque[LargeMessage]] = {}
        self._busy = False

    def behind(self, member: str) -> int:
        """The number of a member's messages that wait or are being decoded."""
        return len(self._waiting.get(member, ()))

    def add(self, large: LargeMessage) -> None:
        """Queue a message."""
        self._waiting.setdefault(large.member, deque()).append(large)
        if not self._busy:
            self._begin(large.member)

    def taken(self, decoded: Decoded) -> None:
        """The main thread has a message: begin the next one, of another member if one waits."""
        member = decoded.large.member
        # Removed and inserted again, because the order of the dict is
        # the order of the members' turns.
        waiting = self._waiting.pop(member)
        waiting.popleft()
        if waiting:
            self._waiting[member] = waiting  # At the end of the dict: it is the last in turn.
        self._busy = False
        if self._waiting:
            self._begin(next(iter(self._waiting)))

    def _begin(self, member: str) -> None:
        large, self._busy = self._waiting[member][0], True
        # One message at a time: several threads would compete for the interpreter with the frames.
        self._system.aside(lambda: self._put(self._decoded(large)))

    def _decoded(self, large: LargeMessage) -> Decoded:
        began = self._system.monotonic()
        message, problem = None, ""
        try:
            message = self._decoder.from_member(large.member, large.body)
        except (ProtocolError, SceneError) as error:
            problem = str(error)
        return Decoded(large, message, problem, self._system.monotonic() - began)
