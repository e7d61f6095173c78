"""A message of FIPA ACL as an event (SC00061; 3.2 of the paper).

Sender and receivers are the event's own. What FIPA writes with a hyphen is written with a line
below it. `reply_by` is the last frame in which the answer may be heard, -1 where there is none:
what happens in a world may not depend on the time of day.
"""

from __future__ import annotations

from typing import Any

from minerva_bus.acl.acts import ACTS, Act
from minerva_bus.errors import MisuseError
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.fields import Default
from minerva_bus.grammar.symbols import EventType
from minerva_bus.grammar.types import Type

NEVER = -1
"""No frame: there is no deadline."""

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
    """Whom an answer goes to: `reply_to`, or else the sender; nobody where there is neither."""
    reply_to: tuple[str, ...] = message.reply_to
    return reply_to or ((message.sender,) if message.sender else ())


def reply(message: Event, act: Act | str, content: str = "", **parameters: Any) -> Event:
    """An answer to a message: of its protocol, conversation, language and ontology.

    `parameters` are those of `eMessage` that shall be otherwise. Raises MisuseError where the
    message does not say who sent it, as then the answer would go to everybody.
    """
    to = answered_to(message)
    if not to:
        raise MisuseError("nobody can be answered: the message has neither sender nor reply_to")
    kept = ("language", "encoding", "ontology", "protocol", "conversation_id")
    given = {name: getattr(message, name) for name in kept}
    given["in_reply_to"] = message.reply_with
    answer: Event = eMessage(act, content, receivers=to, **(given | parameters))
    return answer
