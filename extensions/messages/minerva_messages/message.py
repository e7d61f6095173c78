"""A message of FIPA ACL as an event (SC00061; 3.2 of the paper).

Sender and receivers are those of the event. Names have underscores instead of FIPA's hyphens.
`reply_by` is the last frame in which an answer is valid, or -1: a frame and not a time as in FIPA,
because a world must not depend on the time of day.
"""

from __future__ import annotations

from typing import Any

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.fields import Default
from minerva_bus.grammar.types import Type
from minerva_bus.grammar.vocabulary import EventType
from minerva_messages.acts import ACTS, Act

NEVER = -1
"""Value of `reply_by` without a deadline."""

eMessage = EventType(  # noqa: N816 - event types begin with e
    "eMessage",
    performative=Type("text", words=ACTS),
    content=Default(str, ""),
    language=Default(str, ""),
    encoding=Default(str, ""),
    ontology=Default(str, ""),
    protocol=Default(str, ""),
    conversation_id=Default(str, ""),
    reply_with=Default(str, ""),
    in_reply_to=Default(str, ""),
    reply_to=Default(tuple[str, ...], ()),
    reply_by=Default(int, NEVER),
)


def answered_to(message: Event) -> tuple[str, ...]:
    """The receivers of an answer: `reply_to`, or else the sender, if there is one."""
    reply_to: tuple[str, ...] = message.reply_to
    return reply_to or ((message.sender,) if message.sender else ())


def reply(message: Event, act: Act | str, content: str = "", **parameters: Any) -> Event:
    """An answer to a message, with its protocol, conversation, language and ontology.

    `parameters` replace those of `eMessage`. Raises MisuseError if the message has no sender: an
    event without receivers is sent to all agents.
    """
    to = answered_to(message)
    if not to:
        raise MisuseError("cannot reply: the message has neither sender nor reply_to")
    kept = ("language", "encoding", "ontology", "protocol", "conversation_id")
    given = {name: getattr(message, name) for name in kept}
    # SC00061: the answer repeats the expression that the message requested.
    given["in_reply_to"] = message.reply_with
    answer: Event = eMessage(act, content, receivers=to, **(given | parameters))
    return answer
