"""Receives members' messages and tokens: checks rights and limits, decodes, and informs the runner.

Large messages are decoded in a thread, one at a time, while the frames continue. Messages that no
frame waits for are postponed beyond the time that the coordinator spends on them at once.
"""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false
from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Mapping
from itertools import islice
from threading import Lock
from typing import TYPE_CHECKING, Final, TypeAlias

import zenoh

from minerva_bus.errors import ProtocolError, SceneError
from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.messages import Wire
from minerva_bus.runtime.admission import GUESTS, STRANGERS
from minerva_bus.runtime.metrics import MICRO
from minerva_bus.runtime.session import System
from minerva_bus.values import fast_dataclass
from minerva_bus.wire.codec import Decoder, declaration, stamped
from minerva_bus.wire.keys import COORDINATOR, MAX_NAME, last_part
from minerva_bus.wire.plain import Limits, values_in

if TYPE_CHECKING:
    from minerva_bus.runtime.coordinator import Coordinator


# --- tokens: the presence of members and coordinators ---

HERE: Final = zenoh.SampleKind.PUT
GONE: Final = zenoh.SampleKind.DELETE

MAX_DIGITS: Final = 20
"""Digits of the highest epoch."""

LOOKED_AT: Final = 20
"""Names that are checked at once for one that has room for a change."""

Changes: TypeAlias = tuple[type[s.Appeared] | type[s.Vanished], ...]
_APPEARED: Final[Changes] = (s.Appeared,)
_VANISHED: Final[Changes] = (s.Vanished,)


@fast_dataclass
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


@fast_dataclass
class Successor:
    """A coordinator of this epoch is running."""

    epoch: int


def successor(sample: zenoh.Sample, own: int) -> Successor | None:
    """The coordinator whose token appeared, if its epoch is above the own one."""
    epoch = last_part(str(sample.key_expr))
    there = sample.kind == HERE and epoch.isdecimal() and len(epoch) <= MAX_DIGITS
    return Successor(int(epoch)) if there and int(epoch) > own else None


# --- large messages ---

LARGE: Final = 32 * 1024
"""Bytes above which a message with many values is decoded in a thread."""

MANY_VALUES: Final = 1000
IN_COLUMNS: Final = 256 * 1024
"""Bytes above which one with few values is, too, since ids in a column are decoded one by one."""

MAX_BEHIND: Final = 4
"""Messages of one member that may wait for the thread: a frame asks for one at a time."""


def is_slow(body: bytes) -> bool:
    """Whether to decode a message of more than LARGE bytes in a thread.

    A new thread and its hand-over cost more than it takes to decode columns of this size.
    """
    return len(body) > IN_COLUMNS or values_in(body, MANY_VALUES) > MANY_VALUES


@fast_dataclass
class WaitingMessage:
    """The bytes of a member's message; `joins` counts how often the member has joined so far."""

    member: str
    joins: int
    data: bytes


@fast_dataclass
class Decoded:
    """A large message after decoding, or None and its problem; decoding took `seconds`."""

    large: WaitingMessage
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
        self._waiting: dict[str, deque[WaitingMessage]] = {}
        self._busy = False

    def behind(self, member: str) -> int:
        """The number of a member's messages that wait or are being decoded."""
        return len(self._waiting.get(member, ()))

    def add(self, large: WaitingMessage) -> None:
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

    def _decoded(self, large: WaitingMessage) -> Decoded:
        began = self._system.monotonic()
        message, problem = None, ""
        try:
            message = self._decoder.from_member(large.member, large.data)
        except (ProtocolError, SceneError) as error:
            problem = str(error)
        return Decoded(large, message, problem, self._system.monotonic() - began)


AT_ONCE: Final = 0.01
"""Seconds that the coordinator spends on such messages before replies come first."""

SHARE: Final = 0.25
"""Share of the time that it spends on them while replies or further messages arrive."""

MOST: Final = 10_000
"""Messages that may be postponed; further ones are dropped."""

MOST_BYTES: Final = 64 << 20
"""Bytes of postponed messages above which further ones are dropped."""


class Postponed:
    """A queue of messages, and the time left for them.

    A reply waits behind all messages that arrived before it. So these are decoded only for AT_ONCE
    seconds and for SHARE of the time after that; the rest waits until nothing else has arrived.
    `process` decodes a message. `queue` has the messages that wait.
    """

    def __init__(
        self, process: Callable[[WaitingMessage], None], clock: Callable[[], float]
    ) -> None:
        self._process = process
        self._clock = clock
        self.queue: deque[WaitingMessage] = deque()
        self._bytes = 0
        self._left = AT_ONCE
        self._at = clock()

    def add(self, message: WaitingMessage) -> bool:
        """Process a message after all earlier ones, now if time is left; False if it is dropped."""
        if len(self.queue) >= MOST or self._bytes >= MOST_BYTES:
            return False
        self.queue.append(message)
        self._bytes += len(message.data)
        now = self._clock()
        self._left = min(AT_ONCE, self._left + SHARE * (now - self._at))
        self._at = now
        while self.queue and self._left > 0:
            self.process_next()
        return True

    def process_next(self) -> None:
        """Process the first message, whether time is left or not."""
        message = self.queue.popleft()
        self._bytes -= len(message.data)
        began = self._clock()
        self._process(message)
        self._left -= self._clock() - began


class Receiver:
    """Turns the bytes of members into stimuli of a coordinator's runner.

    `arrived` is called with the name of a member whose hello is admitted. `tokens` has the changes
    of members' tokens, which `take_token` and `tick` process. Large messages return through the
    inbox, as a `Decoded`, once a thread has decoded them. The coordinator processes `postponed`
    messages when nothing else has arrived.
    """

    def __init__(
        self, coordinator: Coordinator, limits: Limits, arrived: Callable[[str], None]
    ) -> None:
        vocabulary, system = coordinator.algorithm.world.vocabulary, coordinator.system
        self._algorithm = coordinator.algorithm
        self._members = coordinator.algorithm.members
        self._handle = coordinator.runner.handle
        self._transport = coordinator.transport
        self._admission = coordinator.admission
        self._metrics = coordinator.metrics
        self._log = coordinator.log
        self._max_members = limits.members
        self._max_tokens = limits.hellos
        self._clock = system.monotonic
        self._arrived = arrived
        self._decoder = Decoder(vocabulary, limits)
        # A decoder caches what it has read, so the thread for large messages has its own.
        self._large = LargeMessages(Decoder(vocabulary, limits), system, coordinator.inbox.put)
        self._again = coordinator.inbox.again
        self.tokens = TokenChanges(self._members.takes_part, limits.members, coordinator.inbox.put)
        self.postponed = Postponed(self._take_postponed, system.monotonic)

    def receive(self, message: tuple[str, bytes]) -> None:
        """Process the bytes that arrived on a member's key."""
        member, data = message
        if self._metrics.on:
            self._metrics.add("bytes in", len(data))
            if self._members.knows(member):
                self._metrics.add(f"bytes of {member}", len(data))
        # Most replies to a tick are empty: equal bytes need neither limits nor decoding, which
        # would cost a world of a thousand members several milliseconds a frame.
        if data == self._transport.empty_reply and member in self._algorithm.now.in_flight.pending:
            self._handle(m.TickReply(member, self._transport.ticked))
            return
        if not self._members.knows(member):
            self._receive_of_stranger(member, data)
            return
        wire = declaration(data, len(self._transport.stamp))
        # A reply that the frame waits for passes regardless of the limits: it can arrive only once
        # per frame, and the frame could not continue without it.
        if wire.awaited and self._algorithm.awaits(member):
            if not self._admission.keeps_out(member):
                self._decode(member, data)
            # Charged like any other, but not before the frame continues.
            self._admission.rules.has_room(member, len(data))
        else:
            self._receive_unasked(member, data, wire)

    def _receive_unasked(self, member: str, data: bytes, wire: Wire) -> None:
        """Process a message that no frame waits for, within the limits of its member."""
        # First, because the rest of a flood must cost next to nothing: replies wait behind it.
        if not self._admission.rules.has_room(member, len(data)):
            self._drop(member)
        elif self._admission.keeps_out(member) or not data:
            return
        elif not self._within_limits(member, data, wire):
            self._drop(member)
        # Nothing waits for this reply, so it is counted as late without the work of decoding it.
        elif wire.awaited and len(data) > LARGE:
            self._count_late(member)
        else:
            joins = self._members.get(member).joins
            if not self.postponed.add(WaitingMessage(member, joins, data)):
                self._drop(member)

    def take_decoded(self, decoded: Decoded) -> None:
        """Process a large message, unless its member has joined again since it was sent."""
        large = decoded.large
        self._large.taken(decoded)
        self._metrics.add("decode", MICRO * decoded.seconds)
        if not self._is_current(large):
            return
        if decoded.message is None:
            self._handle(s.Violation(large.member, decoded.problem))
        else:
            self._pass_on(large.member, large.data, decoded.message)
        # The coordinator has asked for these, so their time is not charged to the member.
        if not isinstance(decoded.message, (m.TickReply, m.EvolveReply)):
            self._admission.rules.spent(large.member, decoded.seconds)

    def take_token(self, _: object = None) -> None:
        """Process the changes of one token; further ones after the next message."""
        rules, began = self._admission.rules, self._clock()
        changes = self.tokens.take(rules.has_token)
        if not changes:
            return
        takes_part = self._members.takes_part(changes[0].member)
        for change in changes:
            if isinstance(change, s.Appeared):
                self._appear(change)
            elif self._members.knows(change.member):
                self._handle(change)
        if not takes_part:
            rules.spent(GUESTS, self._clock() - began)
        if self.tokens:
            self._again(TokensChanged())

    def tick(self) -> None:
        """Process tokens that have waited for room, and count those that were left out."""
        self.take_token()
        for name, number in self.tokens.left_out().items():
            # A few in a row are no flood: the coordinator may have been busy.
            if number > self._max_tokens:
                self._drop(name, number)
            else:
                self._admission.rules.count(name, number)

    def _appear(self, appeared: s.Appeared) -> None:
        """Admit a member whose token appeared, unless it is shut out or there are too many."""
        if self._admission.keeps_out(appeared.member):
            self.tokens.forget(appeared.member)
            # A link that shares its socket (QUIC) cannot be cut: its member waits for an answer.
            if reason := self._admission.rules.shut_out(appeared.member):
                self._transport.send(appeared.member, m.Refused(reason))
            return
        if self._members.knows(appeared.member) or self._members.count < self._max_members:
            self._handle(appeared)
        else:
            self.tokens.forget(appeared.member)
            self._admission.too_many(self._max_members)

    def _receive_of_stranger(self, member: str, data: bytes) -> None:
        """Count a message of an unknown member, which is not decoded."""
        # The limit is checked first: messages over it must cost next to nothing, because those of
        # members wait behind them in the queue.
        if not self._admission.rules.has_room(STRANGERS, len(data)):
            self._drop(STRANGERS)
        elif not self._admission.keeps_out(member):
            self._handle(m.Leaving(member))  # Counts an unknown member, regardless of the message.

    def _take_postponed(self, message: WaitingMessage) -> None:
        member = message.member
        if self._is_current(message):
            began = self._clock()
            self._decode(member, message.data)
            self._admission.rules.spent(member, self._clock() - began)

    def _is_current(self, message: WaitingMessage) -> bool:
        """Whether its member has not joined again: a new process is not the sender."""
        members, member = self._members, message.member
        return members.knows(member) and members.get(member).joins == message.joins

    def _within_limits(self, member: str, data: bytes, wire: Wire) -> bool:
        """Whether a message that no frame waits for is within its member's limits per second."""
        rules = self._admission.rules
        if wire is m.Hello.WIRE and not rules.has_hello(member):
            return False
        return rules.has_values(member, data[len(self._transport.stamp) :])

    def _decode(self, member: str, data: bytes) -> None:
        """Decode a small message now, a large one in a thread, and all of a member in order."""
        stamp = self._transport.stamp
        try:
            if not data.startswith(stamp):
                if data:
                    # Raises ProtocolError for bytes without an epoch. Another epoch is no
                    # violation: the member still follows the predecessor, or already a successor.
                    stamped(data)
                    self._count_late(member)
                return
            body = data[len(stamp) :]
            # A small message behind a large one waits too, because
            # messages of a member keep their order.
            if self._large.behind(member) or (len(body) > LARGE and is_slow(body)):
                self._decode_aside(member, body)
                return
            message = self._metrics.timed("decode", self._decoder.from_member, member, body)
        except (ProtocolError, SceneError) as error:
            self._handle(s.Violation(member, str(error)))
            return
        self._pass_on(member, body, message)

    def _decode_aside(self, member: str, body: bytes) -> None:
        if self._large.behind(member) >= MAX_BEHIND:
            self._drop(member)
            return
        self._large.add(WaitingMessage(member, self._members.get(member).joins, body))

    def _pass_on(self, member: str, body: bytes, message: m.FromMember) -> None:
        # Set in place: nothing else has the message yet, and `replace` would take as long as all
        # else here.
        if isinstance(message, m.EvolveReply):
            message.elapsed = self._clock() - self._transport.evolving_since  # pyright: ignore
        if isinstance(message, (m.EvolveReply, m.TickReply)):
            message.received = body  # pyright: ignore
        reason = ""
        if isinstance(message, m.Hello):
            # A hello shows that the process runs, even if its roles are rejected.
            self._arrived(member)
            reason = self._admission.rules.objection(message)
        self._handle(s.Violation(member, reason) if reason else message)

    def _drop(self, member: str, number: int = 1) -> None:
        """Drop messages or tokens that exceed the limits; log the first."""
        text = self._admission.rules.too_much(member, number)
        if text:
            self._log.warn(member, text)

    def _count_late(self, member: str) -> None:
        """Count a reply for another coordinator, or for a frame that is over."""
        if self._members.knows(member):
            self._members.get(member).late += 1
