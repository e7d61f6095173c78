"""Agents that converse: a base class that keeps conversations in their state.

    class Clerk(Talker, symbol="AClerk"):
        @on("eWish")
        def ask(self, wish, moment):
            self.open(moment, REQUEST, ["printer"], wish.text, reply_by=moment.number + 20)

        def received(self, message, conversation, moment):
            if conversation and conversation.state == "refused":
                ...

The protocols define which acts each side may send in each state (protocols.py); the agent
decides how to answer and what to do.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from minerva_bus.errors import MisuseError, nearest
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.scene import EMPTY, Scene
from minerva_bus.world.agent import Agent
from minerva_bus.world.class_declaration import on
from minerva_bus.world.context import Context
from minerva_messages.acts import ACTS, Act
from minerva_messages.conversation import Conversation, Conversations, PConversation
from minerva_messages.message import NEVER, eMessage, reply
from minerva_messages.protocols import EXPIRED, START, Protocol, Role
from minerva_messages.receiving import numbered, receive


class Talker(Agent):
    """An agent with conversations: `talks` is their string, `opened` counts its own ones."""

    talks: Scene = EMPTY
    opened: int = 0

    def received(
        self, message: Event, conversation: Conversation | None, moment: Context
    ) -> Scene | None:
        """λ for a received message; returns the same as any activity.

        `conversation` is its state after the message; None for a message without a protocol, or
        from outside of the string. In the state `not-understood`, one side did not understand the
        other, and the conversation is over; in `expired`, the message arrived after the deadline.
        """
        return None

    @on("eMessage")
    def listen(self, message: Event, moment: Context) -> Scene | None:
        """Update the conversation of a message, answer errors, and call `received`."""
        effect = receive(Conversations(self.talks), self.id, message, moment.number)
        # Before `received`, whose answers continue from this state.
        self.talks = effect.conversations.scene
        if effect.answer is not None:
            # Errors of the protocol are answered here, so that an
            # agent's own method need not check acts.
            moment.emit(effect.answer)
        return self.received(message, effect.conversation, moment) if effect.delivered else None

    # --- sending ---

    def open(
        self,
        moment: Context,
        protocol: Protocol,
        to: Iterable[str],
        content: str = "",
        *,
        act: Act | str = "",
        reply_by: int = NEVER,
        **parameters: Any,
    ) -> str:
        """Begin a conversation with each of several agents; returns their common id.

        `act` is the first act if a protocol has several (QUERY: `query-if` or `query-ref`).
        `parameters` are those of `eMessage`. Raises MisuseError.
        """
        # Sorted, because the conversations are part of the string.
        receivers = sorted(set(to))
        # A message to the agent itself changes no conversation, so this one would never continue.
        if not receivers or self.id in receivers:
            raise MisuseError(f"#{self.id} opens a {protocol.name} with others, at least one")
        # A counter in the state: ids of conversations must not depend on time or placement.
        self.opened += 1
        name, first = numbered(self.id, self.opened), str(act) or protocol.opening
        # A protocol has two sides, so each receiver gets a conversation; the message is sent once.
        begun = [
            _sent(Conversation(name, protocol.name, Role.INITIATOR, peer), first, reply_by)
            for peer in receivers
        ]
        self._keep(*begun)
        given: dict[str, Any] = {
            "protocol": protocol.name,
            "conversation_id": name,
            "reply_by": reply_by,
        }
        moment.emit(eMessage(first, content, receivers=receivers, **(given | parameters)))
        return name

    def say(
        self,
        moment: Context,
        conversation: Conversation,
        act: Act | str,
        content: str = "",
        *,
        reply_by: int = NEVER,
        **parameters: Any,
    ) -> Conversation:
        """Send an act in a conversation; returns its state after that.

        Raises MisuseError if the protocol does not allow the act, or the conversation is over.
        """
        # The argument may be an old copy, for example of a conversation that has ended since.
        known = self.conversation(conversation.id, conversation.peer)
        after = _sent(known or replace(conversation, state=EXPIRED), str(act), reply_by)
        self._keep(after)
        given: dict[str, Any] = {
            "protocol": after.protocol,
            "conversation_id": after.id,
            "in_reply_to": after.reply_with,
            "reply_by": reply_by,
        }
        to = after.to or (after.peer,)
        moment.emit(eMessage(act, content, receivers=to, **(given | parameters)))
        return after

    def answer(
        self, moment: Context, message: Event, act: Act | str, content: str = "", **more: Any
    ) -> None:
        """Answer a message that belongs to no conversation. Raises MisuseError without a sender."""
        moment.emit(reply(message, act, content, **more))

    def award(
        self,
        moment: Context,
        bids: Iterable[Conversation],
        best: Conversation,
        content: str = "",
        **parameters: Any,
    ) -> None:
        """Accept the best of the proposals of a contract net, and reject the others."""
        for bid in bids:
            # By peer, because states of conversations change with each act.
            if bid.peer == best.peer:
                self.say(moment, bid, Act.ACCEPT_PROPOSAL, content, **parameters)
            else:
                self.say(moment, bid, Act.REJECT_PROPOSAL)

    # --- open conversations ---

    def conversation(self, id: str, peer: str) -> Conversation | None:
        """The open conversation with this id and agent, or None."""
        return Conversations(self.talks).find(id, peer)

    def conversations(
        self, protocol: Protocol | None = None, *, id: str = "", state: str = "", role: str = ""
    ) -> list[Conversation]:
        """The open conversations, oldest first."""
        return [
            conversation
            for conversation in Conversations(self.talks)
            if (protocol is None or conversation.protocol == protocol.name)
            and id in ("", conversation.id)
            and state in ("", conversation.state)
            and role in ("", conversation.role)
        ]

    def expire(self, moment: Context) -> list[Conversation]:
        """End the conversations whose deadline has passed; returns them in the state `expired`.

        Call it in an activity of each frame: a missing answer causes no event.
        """
        kept = Conversations(self.talks)
        gone = [conversation for conversation in kept if conversation.expired(moment.number)]
        for conversation in gone:
            kept = kept.drop(conversation)
        self.talks = kept.scene
        return [replace(conversation, state=EXPIRED) for conversation in gone]

    def _keep(self, *conversations: Conversation) -> None:
        self.talks = Conversations(self.talks).keep(*conversations).scene


def _sent(conversation: Conversation, act: str, deadline: int) -> Conversation:
    """The conversation after an act of its own side. Raises MisuseError."""
    if act not in ACTS:
        raise MisuseError(f"there is no communicative act {act!r}{nearest(act, list(ACTS))}")
    after = conversation.sent(act, deadline)
    if after is None:
        where = (
            "cannot begin with"
            if conversation.state == START
            else f"is {conversation.state}: it does not allow"
        )
        about = f"{conversation.protocol} {conversation.id} with #{conversation.peer}"
        raise MisuseError(f"{about} {where} {act} by {conversation.role}")
    return after


MESSAGES = (eMessage, PConversation)
"""Symbols that a vocabulary needs if agents converse."""
