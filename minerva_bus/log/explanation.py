"""An explanation of a value in a record: a chain of events and methods, as text and as JSON."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final

from minerva_bus.source import SourceLine
from minerva_bus.wording import named_some, short

MAX_PERCEIVED: Final = 6
MAX_REJECTED: Final = 5
MAX_VALUE: Final = 60


@dataclass(frozen=True, slots=True)
class EventSource:
    """The source of an event: its kind, its name and the frame in which it was sent.

    `kind` is "agent", "generator", "person", "norm" or "unknown". The name of a person is
    `people:NAME`, as in norms, or that of a generator that represents people. `order` is the order
    that a generator was given before, with its frame, and `person` the name of who sent it, if any.
    """

    kind: str
    name: str
    frame: int
    order: str = ""
    person: str = ""

    @property
    def text(self) -> str:
        """The source in words."""
        if self.kind == "agent":
            return f"#{self.name}"
        if self.kind == "person" and self.name.startswith("people:"):
            return f"the person {self.name.partition(':')[2]}"
        if self.kind == "person":
            return f"a person, through {self.name}" if self.name else "a person"
        if self.kind == "generator":
            return f"the generator {self.name}" if self.name else "a generator"
        return f"the norm {self.name}".rstrip() if self.kind == "norm" else "an unknown source"


@dataclass(frozen=True, slots=True)
class Cause:
    """One step of the chain: what an agent did in a frame, by which method, because of which event.

    `did` is the change or the event that is explained. `place` is the line of the method that did
    it, `agent` the agent whose method it is; both are empty if no code ran. `event` caused the
    call and has the `source`. `perceived` are all events that the agent received in the frame, by
    type, with their numbers.
    """

    frame: int
    agent: str
    did: str
    method: str = ""
    place: SourceLine | None = None
    event: str = ""
    source: EventSource | None = None
    perceived: tuple[tuple[str, int], ...] = ()
    remark: str = ""

    def plain(self) -> dict[str, Any]:
        """As a JSON object."""
        return {
            "frame": self.frame,
            "agent": self.agent,
            "did": self.did,
            "method": self.method,
            "place": None if self.place is None else self.place.plain(),
            "event": self.event,
            "source": None if self.source is None else asdict(self.source),
            "perceived": dict(self.perceived),
            "remark": self.remark,
        }

    def lines(self) -> list[str]:
        """As lines of text."""
        shown = [f"frame {self.frame}: #{self.agent} {self.did}"]
        if self.place is not None:
            shown.append(f"  in {self.method}, {self.place.where}")
            shown += [f"      {text}" for text in self.place.shown[:1]]
        elif self.method:
            shown.append(f"  in {self.method}")
        if self.event:
            source = f", from {self.source.text}" if self.source is not None else ""
            shown.append(f"  because it received {short(self.event)}{source}")
        if self.perceived:
            counts = [f"{name} ×{count}" if count > 1 else name for name, count in self.perceived]
            shown.append(f"  all that it received: {named_some(counts, MAX_PERCEIVED)}")
        if self.remark:
            shown.append(f"  {self.remark}")
        return shown


@dataclass(frozen=True, slots=True)
class Explanation:
    """How an agent's attribute got its value.

    `value` is that at the beginning of `frame`; `since` is the frame in which it became so, -1 for
    the initial string. `links` lead from there back to `origin`. `rejected` are events and steps
    of the agent that norms have rejected in the last frames. `first` is the first frame that is
    known; -1 for `since` means that the value is older.
    """

    world: str
    agent: str
    kind: str
    attribute: str
    value: str
    frame: int
    since: int
    links: tuple[Cause, ...]
    origin: str
    rejected: tuple[str, ...] = ()
    first: int = 0

    @property
    def is_older(self) -> bool:
        """Whether the value is older than the frames that are known."""
        return self.since < 0 < self.first

    def plain(self) -> dict[str, Any]:
        """As a JSON object."""
        own = {name: getattr(self, name) for name in self.__slots__}
        links = [link.plain() for link in self.links]
        return {**own, "links": links, "rejected": list(self.rejected)}

    def lines(self) -> list[str]:
        """As lines of text."""
        older = f"since before frame {self.first}" if self.first else "since the initial string"
        since = f"since frame {self.since}" if self.since >= 0 else older
        about = f"{self.kind}#{self.agent} {self.attribute} = {short(self.value, MAX_VALUE)}"
        shown = [f"{about} at the beginning of frame {self.frame}, {since}"]
        shown += [line for link in self.links for line in link.lines()]
        shown.append(f"origin: {self.origin}")
        shown += rejected_lines(self.rejected)
        return shown


def rejected_lines(rejected: Sequence[str]) -> list[str]:
    """Rejections as lines of text, the last ones first."""
    if not rejected:
        return []
    more = len(rejected) - MAX_REJECTED
    shown = [f"  {text}" for text in rejected[:MAX_REJECTED]]
    return ["recently rejected:", *shown, *([f"  and {more} more"] if more > 0 else [])]
