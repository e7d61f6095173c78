"""Effect of a message on the conversations of its receiver; pure.

An act that the protocol does not allow in the conversation's state is answered with
`not-understood`, which ends the conversation on both sides. The same applies to an act that names a
protocol but belongs to no conversation. `not-understood` itself is never answered.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from minerva_bus.grammar.events import Event
from minerva_messages.acts import Act
from minerva_messages.conversation import Conversation, Conversations
from minerva_messages.message import reply
from minerva_messages.protocols import CONTRACT_NET, EXPIRED, NOT_UNDERSTOOD, PROTOCOLS, Role

TOO_LATE = "too late"


@dataclass(frozen=True, slots=True)
class Received:
    """The effect of a message: all conversations after it, and that of the message, if any.

    `answer` must be sent immediately. `delivered`: whether the agent's own method is called.
    """

    conversations: Conversations
    conversation: Conversation | None = None
    answer: Event | None = None
    delivered: bool = True


def receive(conversations: Conversations, me: str, message: Event, frame: int) -> Received:
    """The effect of a message on the conversations of the agent `me` in a frame."""
    # A message without receivers reaches its sender as well.
    if message.sender == me:
        return Received(conversations, delivered=False)
    if not message.sender:
        return Received(
            conversations
        )  # From outside of the string, so there is no agent to answer.
    known = conversations.find(message.conversation_id, message.sender)
    if known is None:
        return _first(conversations, me, message)
    # Checked here as well as by `expire`, which an agent may not call in each frame.
    if known.expired(frame):
        return _late(conversations.drop(known), known, message)
    after = known.received(message)
    if after is not None:
        return Received(conversations.keep(after), after)
    # Both sides end the conversation: after an act that is not allowed their states differ.
    broken = replace(known, state=NOT_UNDERSTOOD, content=message.content)
    why = f"{message.performative} where {known.protocol} is {known.state}"
    return Received(conversations.keep(broken), broken, _not_understood(message, why))


def _first(conversations: Conversations, me: str, message: Event) -> Received:
    """The effect of a message without a conversation, which may begin one."""
    name: str = message.protocol
    # Without a protocol there is nothing to check. `not-understood` is never answered, or two
    # agents could answer each other forever.
    if not name or message.performative == Act.NOT_UNDERSTOOD:
        return Received(conversations)
    if name not in PROTOCOLS:
        return _refused(conversations, message, f"there is no protocol {name} here")
    fresh = Conversation(message.conversation_id, name, Role.PARTICIPANT, message.sender)
    begun = fresh.received(message)
    if begun is not None:
        return Received(conversations.keep(begun), begun)
    # The conversation no longer exists, but its id still names the agent that opened it.
    if _late_bid(message) and opener(message.conversation_id) == me:
        return Received(conversations, answer=_too_late(message), delivered=False)
    why = f"{message.performative} where no {name} {message.conversation_id} is under way"
    return _refused(conversations, message, why)


def _late(conversations: Conversations, expired: Conversation, message: Event) -> Received:
    """The effect of a message to a conversation whose deadline has passed."""
    over = replace(expired, state=EXPIRED)
    if message.performative == Act.NOT_UNDERSTOOD:
        return Received(conversations, over)
    if _late_bid(message) and expired.role == Role.INITIATOR:
        return Received(conversations, over, _too_late(message))
    return Received(conversations, over, _not_understood(message, TOO_LATE))


def _late_bid(message: Event) -> bool:
    """Whether a message is a bid of a contract net: SC00029 requires a rejection of late bids."""
    return message.protocol == CONTRACT_NET.name and message.performative == Act.PROPOSE


def _refused(conversations: Conversations, message: Event, why: str) -> Received:
    return Received(conversations, answer=_not_understood(message, why), delivered=False)


def _not_understood(message: Event, why: str) -> Event | None:
    if message.performative == Act.NOT_UNDERSTOOD:
        return None
    return reply(message, Act.NOT_UNDERSTOOD, why)


def _too_late(message: Event) -> Event:
    return reply(message, Act.REJECT_PROPOSAL, TOO_LATE)


def numbered(me: str, number: int) -> str:
    """The id of a conversation that an agent opens."""
    return f"{me}/{number}"


def opener(conversation_id: str) -> str:
    """The agent that opened a conversation, from the id that `numbered` made."""
    return conversation_id.rpartition("/")[0]
