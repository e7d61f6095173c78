"""Receives members' messages: checks rights and limits, decodes, and informs the runner."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

from minerva_bus.errors import ProtocolError, SceneError
from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.messages import Wire
from minerva_bus.runtime.admission_rules import GUESTS, STRANGERS
from minerva_bus.runtime.large import (
    LARGE,
    MAX_BEHIND,
    Decoded,
    LargeMessage,
    LargeMessages,
    is_slow,
)
from minerva_bus.runtime.metrics import MICRO
from minerva_bus.runtime.postponed import Postponed, PostponedMessage
from minerva_bus.runtime.presence import TokenChanges, TokensChanged
from minerva_bus.wire.codec import Decoder, declaration, stamped
from minerva_bus.wire.message_limits import Limits

if TYPE_CHECKING:
    from minerva_bus.runtime.coordinator import Coordinator


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
        # Most replies to a tick are empty: equal bytes need neither limits nor decoding, which
        # would cost a world of a thousand members several milliseconds a frame.
        if data == self._transport.empty_reply and self._algorithm.awaits_tick(member):
            self._handle(m.TickReply(member, self._transport.ticked))
            return
        if not self._members.knows(member):
            self._receive_of_stranger(member, data)
            return
        # Every message is charged, even one that then passes regardless of the limits.
        room = self._admission.rules.has_room(member, len(data))
        # The rest of a flood must cost next to nothing: replies wait behind it in the queue.
        if not room and not self._algorithm.awaits(member):
            self._drop(member)
            return
        if self._admission.keeps_out(member):
            return
        wire = declaration(data, len(self._transport.stamp))
        # A reply that the frame waits for passes regardless of the limits: it can arrive only once
        # per frame, and the frame could not continue without it.
        if not data or (wire.awaited and self._algorithm.awaits(member)):
            self._decode(member, data)
        elif not (room and self._within_limits(member, data, wire)):
            self._drop(member)
        # Nothing waits for this reply, so it is counted as late without the work of decoding it.
        elif wire.awaited and len(data) > LARGE:
            self._count_late(member)
        else:
            joins = self._members.get(member).joins
            if not self.postponed.add(PostponedMessage(member, joins, data)):
                self._drop(member)

    def take_decoded(self, decoded: Decoded) -> None:
        """Process a large message, unless its member has joined again since it was sent."""
        large = decoded.large
        self._large.taken(decoded)
        self._metrics.add("decode", MICRO * decoded.seconds)
        members = self._members
        # A message of the former process must not count for the new one.
        if not members.knows(large.member) or members.get(large.member).joins != large.joins:
            return
        if decoded.message is None:
            self._handle(s.Violation(large.member, decoded.problem))
        else:
            self._pass_on(large.member, large.body, decoded.message)
        # The coordinator has asked for these, so their time is not charged to the member.
        if not isinstance(decoded.message, m.TickReply | m.EvolveReply):
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

    def _take_postponed(self, message: PostponedMessage) -> None:
        member = message.member
        # A message of the former process must not count for the new one.
        if self._members.knows(member) and self._members.get(member).joins == message.joins:
            began = self._clock()
            self._decode(member, message.data)
            self._admission.rules.spent(member, self._clock() - began)

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
            if self._large.behind(member) or is_slow(body):
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
        self._large.add(LargeMessage(member, self._members.get(member).joins, body))

    def _pass_on(self, member: str, body: bytes, message: m.FromMember) -> None:
        if isinstance(message, m.EvolveReply):
            elapsed = self._clock() - self._transport.evolving_since
            message = replace(message, elapsed=elapsed, received=body)
        elif isinstance(message, m.TickReply):
            message = replace(message, received=body)
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
