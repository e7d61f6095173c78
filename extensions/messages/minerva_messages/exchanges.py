"""The messages between agents in a record, as data and as a sequence diagram in Mermaid.

Syntax: https://mermaid.js.org/syntax/sequenceDiagram.html
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

from minerva_bus.errors import RecordError, nearest
from minerva_bus.grammar.events import Event, single
from minerva_bus.log.record import Record
from minerva_messages.message import NEVER, eMessage

EVERYBODY: Final = "everybody"
NOBODY: Final = "somebody outside"
MOST: Final = 400
"""Most messages of a diagram that is still readable."""

NAMED: Final = 8
LONGEST: Final = 60


@dataclass(frozen=True, slots=True)
class SentMessage:
    """A message among the events of a frame."""

    frame: int
    sender: str
    receivers: tuple[str, ...]
    act: str
    content: str
    protocol: str
    conversation: str
    reply_by: int

    @staticmethod
    def of(frame: int, event: Event) -> SentMessage:
        """The message of an event of the type `eMessage`."""
        return SentMessage(
            frame,
            event.sender or NOBODY,
            event.receivers or (EVERYBODY,),
            event.performative,
            event.content,
            event.protocol,
            event.conversation_id,
            event.reply_by,
        )

    @property
    def label(self) -> str:
        """The act, its content, cut to LONGEST letters, and its deadline."""
        # Line ends would end the statement in Mermaid and the label in SVG.
        content = " ".join(self.content.split())
        if len(content) > LONGEST:
            content = content[: LONGEST - 1] + "…"
        by = f" (by frame {self.reply_by})" if self.reply_by != NEVER else ""
        return f"{self.act}{': ' if content else ''}{content}{by}"

    def plain(self) -> dict[str, Any]:
        """As one JSON object."""
        return {
            "frame": self.frame,
            "sender": self.sender,
            "receivers": list(self.receivers),
            "performative": self.act,
            "content": self.content,
            "protocol": self.protocol,
            "conversation": self.conversation,
            "reply_by": self.reply_by,
        }


@dataclass(frozen=True, slots=True)
class Exchange:
    """Messages in order; `title` names the world and the conversation."""

    title: str
    messages: tuple[SentMessage, ...]

    @property
    def agents(self) -> tuple[str, ...]:
        """The agents, in the order in which they first send or receive a message."""
        names = [name for message in self.messages for name in (message.sender, *message.receivers)]
        return tuple(dict.fromkeys(names))

    def plain(self) -> dict[str, Any]:
        """As one JSON object."""
        return {
            "title": self.title,
            "agents": list(self.agents),
            "messages": [message.plain() for message in self.messages],
        }

    def mermaid(self) -> str:
        """As a sequence diagram in Mermaid."""
        return "\n".join(self._lines()) + "\n"

    def _lines(self) -> Iterator[str]:
        # Numbers, because ids of agents may contain characters that
        # Mermaid does not allow in names.
        ids = {name: f"a{number}" for number, name in enumerate(self.agents)}
        yield "sequenceDiagram"
        for name, id in ids.items():
            yield f"    participant {id} as {_escaped(name)}"
        first, last = ids[self.agents[0]], ids[self.agents[-1]]
        over = first if first == last else f"{first},{last}"
        frame = None
        for message in self.messages:
            if message.frame != frame:
                frame = message.frame
                yield f"    Note over {over}: frame {frame}"
            # Mermaid has no arrow to several participants.
            for receiver in message.receivers:
                yield f"    {ids[message.sender]}->>{ids[receiver]}: {_escaped(message.label)}"


def exchange_of(record: Record, conversation: str = "") -> Exchange:
    """The messages of a record, or of one conversation. Raises RecordError if there are none."""
    sent = [
        SentMessage.of(frame.number, event)
        for frame in record.frames()
        for event in single(frame.events)
        if event.type == eMessage.name
    ]
    if not sent:
        raise RecordError(
            f"{record.path}: agents exchanged no messages: there is no {eMessage.name}"
        )
    world = record.description.world.name
    if not conversation:
        return Exchange(world, tuple(sent))
    chosen = tuple([message for message in sent if message.conversation == conversation])
    if not chosen:
        known = _conversations(sent)
        near = nearest(conversation, known)
        raise RecordError(
            f"{record.path}: there is no conversation {conversation!r}{near}; {_named(known)}"
        )
    protocol = chosen[0].protocol
    return Exchange(f"{world}: {conversation}{protocol and f', {protocol}'}", chosen)


def check_drawable(record: Record, exchange: Exchange) -> None:
    """Raises RecordError if there are too many messages for one diagram."""
    count = len(exchange.messages)
    if count > MOST:
        known = _conversations(list(exchange.messages))
        choose = f"; choose one with --conversation: {_named(known)}" if len(known) > 1 else ""
        raise RecordError(
            f"{record.path}: {count:,} messages are too many for one picture, which shows {MOST}"
            f" at most{choose}, or take all with --json"
        )


def _conversations(messages: list[SentMessage]) -> list[str]:
    return [
        conversation
        for conversation in dict.fromkeys(message.conversation for message in messages)
        if conversation
    ]


def _named(known: list[str]) -> str:
    if not known:
        return "no message names one"
    more = f" and {len(known) - NAMED:,} more" if len(known) > NAMED else ""
    return f"there are {', '.join(known[:NAMED])}{more}"


def _escaped(text: str) -> str:
    """A text whose special characters in Mermaid are replaced by entities of the form #NN;."""
    return "".join(
        [f"#{ord(letter)};" if letter in "#;<>&%\"'`{}\\" else letter for letter in text]
    )
