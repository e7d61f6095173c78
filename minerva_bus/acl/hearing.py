"""What a message does to the conversations of whoever hears it; pure.

An act that a conversation's protocol does not allow where it stands is answered by
`not-understood`, and so is one that belongs to no conversation but says a protocol's name. That
ends the conversation on both sides. `not-understood` itself is never answered.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from minerva_bus.acl.acts import Act
from minerva_bus.acl.conversation import Conversation, Conversations
from minerva_bus.acl.message import reply
from minerva_bus.acl.protocols import (
    CONTRACT_NET,
    EXPIRED,
    NOT_UNDERSTOOD,
    PROTOCOLS,
    Role,
)
from minerva_bus.grammar.events import Event

TOO_LATE = "too late"


@dataclass(frozen=True, slots=True)
class Heard:
    """What comes of a message: the conversations after it, and the one that it belongs to.

    `conversation` is None where it belongs to none. `answer` goes out at once. `told`: whether
    the agent is to be told of the message at all.
    """

    conversations: Conversations
    conversation: Conversation | None = None
    answer: Event | None = None
    told: bool = True


def hear(conversations: Conversations, me: str, message: Event, frame: int) -> Heard:
    """What the message does to the conversations of the agent `me` in a frame."""
    if message.sender == me:
        return Heard(conversations, told=False)
    if not message.sender:
        return Heard(conversations)  # Somebody outside of the string, who cannot be answered.
    found = conversations.find(message.conversation_id, message.sender)
    if found is None:
        return _first(conversations, me, message)
    if found.expired(frame):
        return _late(conversations.drop(found), found, message)
    after = found.heard(message)
    if after is not None:
        return Heard(conversations.keep(after), after)
    broken = replace(found, state=NOT_UNDERSTOOD, content=message.content)
    why = f"{message.performative} where {found.protocol} is {found.state}"
    return Heard(conversations.keep(broken), broken, _not_understood(message, why))


def _first(conversations: Conversations, me: str, message: Event) -> Heard:
    """A message that belongs to no conversation: one may begin with it."""
    name: str = message.protocol
    if not name or message.performative == Act.NOT_UNDERSTOOD:
        return Heard(conversations)
    if name not in PROTOCOLS:
        return _refused(conversations, message, f"there is no protocol {name} here")
    fresh = Conversation(message.conversation_id, name, Role.PARTICIPANT, message.sender)
    begun = fresh.heard(message)
    if begun is not None:
        return Heard(conversations.keep(begun), begun)
    if _late_bid(message) and opener(message.conversation_id) == me:
        return Heard(conversations, answer=_too_late(message), told=False)
    why = f"{message.performative} where no {name} {message.conversation_id} is under way"
    return _refused(conversations, message, why)


def _late(conversations: Conversations, expired: Conversation, message: Event) -> Heard:
    """A message to a conversation whose deadline has passed."""
    over = replace(expired, state=EXPIRED)
    if message.performative == Act.NOT_UNDERSTOOD:
        return Heard(conversations, over)
    if _late_bid(message) and expired.role == Role.INITIATOR:
        return Heard(conversations, over, _too_late(message))
    return Heard(conversations, over, _not_understood(message, TOO_LATE))


def _late_bid(message: Event) -> bool:
    """Whether it is a bid of a contract net, which SC00029 has rejected where it comes late."""
    return message.protocol == CONTRACT_NET.name and message.performative == Act.PROPOSE


def _refused(conversations: Conversations, message: Event, why: str) -> Heard:
    return Heard(conversations, answer=_not_understood(message, why), told=False)


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
    """Who has opened the conversation of an id that an agent of the string has made."""
    return conversation_id.rpartition("/")[0]
