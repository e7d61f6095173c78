"""Messages of the world as those of SPADE, and back.

SPADE has the content as the body of an XMPP message, and what else FIPA knows as its metadata, a
data form (XEP-0004) of texts, by the names of SC00061.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any, Final

from minerva_bus.acl import eMessage
from minerva_bus.acl.acts import ACTS
from minerva_bus.acl.kqml import NEAREST
from minerva_bus.acl.message import NEVER
from minerva_bus.grammar.events import Event
from minerva_bus.semantics.geometry import Geometry
from minerva_services.bridges.spade.addresses import Addresses

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
"""FIPA's names of those that are texts, and ours."""


class Garbage(Exception):
    """A message that is none of FIPA ACL; the text says why."""


@dataclass(frozen=True, slots=True)
class Mail:
    """A message to one agent outside: from whom, and its parameters as `eMessage` has them."""

    frame: int
    sender: str
    to: str
    parameters: Mapping[str, Any]


class Mailbox(Geometry):
    """A geometric system of messages: α of `PMail` is a message to the `TOutside` around it."""

    def __init__(self) -> None:
        self.mail: list[Mail] = []
        self.there: list[str] = []
        self._to = ""

    @contextmanager
    def TOutside(self, id: str) -> Generator[None]:
        """β and δ: whom the messages within are for."""
        self.there.append(id)
        self._to = id
        yield
        self._to = ""

    def PMail(self, frame: int, sender: str, **parameters: Any) -> None:
        """α: a message."""
        self.mail.append(Mail(frame, sender, self._to, parameters))


@dataclass(frozen=True, slots=True)
class Clock:
    """Frames as times of day, for those outside: as if the world ran in real time."""

    frame: int
    dt: float

    def time_of(self, frame: int) -> str:
        """When a frame will be, ISO 8601."""
        wait = timedelta(seconds=max(0, frame - self.frame) * self.dt)
        return (datetime.now(UTC) + wait).isoformat(timespec="milliseconds")

    def frame_at(self, time: str) -> int:
        """The frame at a time. Raises Garbage."""
        try:
            then = datetime.fromisoformat(time)
            zoned = then if then.tzinfo is not None else then.astimezone()
            wait = (zoned - datetime.now(UTC)).total_seconds()
        except (ValueError, OverflowError):
            raise Garbage(f"reply-by is {time!r}; expected a time in ISO 8601") from None
        return max(0, self.frame + round(wait / self.dt))


def metadata_of(
    given: Mapping[str, Any], known: tuple[Addresses, ...], clock: Clock
) -> dict[str, str]:
    """What SPADE is told of a message besides its body."""
    found: dict[str, str] = {theirs: given[ours] for theirs, ours in _TEXTS.items() if given[ours]}
    jids = [jid for id in given["reply_to"] for one in known if (jid := one.jid(id))]
    if jids:
        found["reply-to"] = " ".join(jids)
    if given["reply_by"] != NEVER:
        found["reply-by"] = clock.time_of(given["reply_by"])
    return found


def event_of(
    body: str,
    thread: str,
    metadata: Mapping[str, str],
    sender: str,
    receiver: str,
    known: tuple[Addresses, ...],
    clock: Clock,
) -> Event:
    """The event that a message of SPADE's is. A performative of KQML is the nearest act.

    Raises Garbage.
    """
    told = {ours: metadata.get(theirs, "") for theirs, ours in _TEXTS.items()}
    told["performative"] = _act(told["performative"])
    told["conversation_id"] = told["conversation_id"] or thread
    jids = metadata.get("reply-to", "").replace(",", " ").split()
    by = metadata.get("reply-by", "")
    event: Event = eMessage(
        **told,
        content=body,
        reply_to=tuple(id for jid in jids for one in known if (id := one.id(jid))),
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
        raise Garbage(f"performative is {performative!r}, no communicative act")
    return str(nearest)
