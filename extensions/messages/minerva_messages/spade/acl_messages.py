"""Conversion between the world's ACL messages and SPADE's.

SPADE sends the content as the body of an XMPP message, and the other FIPA parameters as metadata, a
data form (XEP-0004) of strings named as in SC00061.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any, Final

from minerva_bus.grammar.events import Event
from minerva_bus.semantics.geometry import Geometry
from minerva_messages import eMessage
from minerva_messages.acts import ACTS
from minerva_messages.kqml import NEAREST
from minerva_messages.message import NEVER
from minerva_messages.spade.addresses import Addresses

_TEXTS: Final = {
    "performative": "performative",
    "language": "language",
    "encoding": "encoding",
    "ontology": "ontology",
    "protocol": "protocol",
    "conversation-id": "conversation_id",
    "reply-with": "reply_with",
    "in-reply-to": "in_reply_to",
}
"""FIPA parameters that are strings, and our names for them."""


class InvalidMessage(Exception):
    """Not a FIPA ACL message; the text gives the reason."""


@dataclass(frozen=True, slots=True)
class Mail:
    """A message to an external agent: sender and the parameters of `eMessage`."""

    frame: int
    sender: str
    to: str
    parameters: Mapping[str, Any]


class Mailbox(Geometry):
    """A geometric system of messages: α of `PMail` is a message to the enclosing `TOutside`."""

    def __init__(self) -> None:
        self.mail: list[Mail] = []
        self.there: list[str] = []
        self._to = ""

    @contextmanager
    def TOutside(self, id: str) -> Generator[None]:
        """β and δ: the receiver of the messages within."""
        self.there.append(id)
        self._to = id
        yield
        self._to = ""

    def PMail(self, frame: int, sender: str, **parameters: Any) -> None:
        """α: a message."""
        self.mail.append(Mail(frame, sender, self._to, parameters))


@dataclass(frozen=True, slots=True)
class Clock:
    """Conversion between frames and wall-clock times, assuming the world runs in real time."""

    frame: int
    dt: float

    def time_of(self, frame: int) -> str:
        """Expected time of a frame, ISO 8601."""
        wait = timedelta(seconds=max(0, frame - self.frame) * self.dt)
        return (datetime.now(UTC) + wait).isoformat(timespec="milliseconds")

    def frame_at(self, time: str) -> int:
        """The frame at a time. Raises InvalidMessage."""
        try:
            then = datetime.fromisoformat(time)
            # ISO 8601: a time without a zone is local.
            zoned = then if then.tzinfo is not None else then.astimezone()
            wait = (zoned - datetime.now(UTC)).total_seconds()
        except (ValueError, OverflowError):
            raise InvalidMessage(f"reply-by is {time!r}; expected a time in ISO 8601") from None
        return max(0, self.frame + round(wait / self.dt))


def metadata_of(
    parameters: Mapping[str, Any], known: tuple[Addresses, ...], clock: Clock
) -> dict[str, str]:
    """SPADE metadata of a message."""
    metadata: dict[str, str] = {
        theirs: parameters[ours] for theirs, ours in _TEXTS.items() if parameters[ours]
    }
    jids = [
        jid for id in parameters["reply_to"] for addresses in known if (jid := addresses.jid(id))
    ]
    if jids:
        metadata["reply-to"] = " ".join(jids)
    if parameters["reply_by"] != NEVER:
        metadata["reply-by"] = clock.time_of(parameters["reply_by"])
    return metadata


def event_of(
    body: str,
    thread: str,
    metadata: Mapping[str, str],
    sender: str,
    receiver: str,
    known: tuple[Addresses, ...],
    clock: Clock,
) -> Event:
    """The event for a SPADE message; KQML performatives map to the nearest act.

    Raises InvalidMessage.
    """
    texts = {ours: metadata.get(theirs, "") for theirs, ours in _TEXTS.items()}
    texts["performative"] = _act(texts["performative"])
    # Without the parameter, XMPP's thread identifies the conversation.
    texts["conversation_id"] = texts["conversation_id"] or thread
    jids = metadata.get("reply-to", "").replace(",", " ").split()
    by = metadata.get("reply-by", "")
    event: Event = eMessage(
        **texts,
        content=body,
        reply_to=tuple(id for jid in jids for addresses in known if (id := addresses.id(jid))),
        reply_by=clock.frame_at(by) if by else NEVER,
        sender=sender,
        receivers=[receiver],
    )
    return event


def _act(performative: str) -> str:
    if performative in ACTS:
        return performative
    nearest = NEAREST.get(performative)
    if nearest is None:
        raise InvalidMessage(f"performative is {performative!r}, which is not a communicative act")
    return str(nearest)
