"""Inputs and outputs of the frame algorithm: stimuli in, instructions out.

`FrameInputs` and `Checkpoint` determine a frame, besides the string: its inputs, and the state from
the frame before. Journals and records have both, with the names of the sources of events that are
not members.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final, TypeAlias, cast

from minerva_bus.frame.composition import Layout
from minerva_bus.frame.messages import (
    EvolveReply,
    EvolveRequest,
    Figures,
    Fragments,
    FrameRecord,
    FromMember,
    Orders,
    Parts,
    TickReply,
    ToMember,
    ViewShown,
)
from minerva_bus.grammar.columns import unfolded
from minerva_bus.grammar.events import AnyEvent, Event, single
from minerva_bus.values import fast_dataclass
from minerva_bus.world.norms import SOURCE

PEOPLE: Final = "~order"
"""Source of people's events, to which norms apply as to those of generators; of a person with a
name it is `~order:NAME`."""

AGENTS: Final = "#"
"""Source of all events that agents send; no generator can have this name."""

DEVICES: Final = "~device"
"""Source of the visual events that devices request by their `when`."""

HANDED_OVER: Final = "~handed"
"""Key of the orders taken by generators in the inputs of a frame."""


DROPPED: Final = "~dropped:"
"""Prefix, in the inputs of a frame, of a source whose events were left out of it after all."""


OrdersBySource: TypeAlias = Mapping[str, Sequence[AnyEvent]]
"""People's orders by source."""


def source_of(person: str) -> str:
    """The source of a person's events; "" is a person without a name."""
    return f"{PEOPLE}:{person}" if person else PEOPLE


def is_people(source: str) -> bool:
    """Whether events of a source are sent by people."""
    return source.partition(":")[0] == PEOPLE


def name_of(source: str) -> str:
    """The name of the person who is a source; empty for a person without a name."""
    return source.partition(":")[2]


def person_of(source: str) -> str:
    """The name of the person who is a source, or `people`."""
    return name_of(source) or "people"


def is_handed_over(source: str) -> bool:
    """Whether a source of a record has orders that a generator took."""
    return source.partition(":")[0] == HANDED_OVER


def is_dropped(source: str) -> bool:
    """Whether a source of a record has events that were left out of its frame."""
    return source.startswith(DROPPED)


def is_set_aside(source: str) -> bool:
    """Whether events of a source of a record are not among those that hosts got."""
    return is_handed_over(source) or is_dropped(source)


def handed_over(source: str) -> str:
    """The name under which a record has the orders of a source that a generator took."""
    return HANDED_OVER + source.removeprefix(PEOPLE)


def people_of(handed: str) -> str:
    """The inverse of `handed_over`."""
    return PEOPLE + handed.removeprefix(HANDED_OVER)


@fast_dataclass
class FrameInputs:
    """Input of the frame algorithm in one frame, as far as it was used.

    `due`: visual event types for which a device requested a view.
    `ticked`: replies of members in step (step 2), by member.
    `taken`: events of other sources, by source.
    `layout`: the division of populations into fragments.
    `replies`: replies of hosts (steps 5 and 6), in the order in which they were merged.
    `waiting`: events by source that arrived during the frame and count in the next one.
    `people`: sources whose events count as sent by people (for norms).
    `answers`: number of replies to the first request, and to each repeated request after a norm
    rejected an outcome.
    `left_out`: fragments without a reply.
    """

    frame: int
    due: tuple[str, ...]
    ticked: Mapping[str, TickReply]
    taken: Mapping[str, Sequence[AnyEvent]]
    layout: Layout
    replies: Sequence[EvolveReply]
    waiting: Mapping[str, Sequence[AnyEvent]]
    people: tuple[str, ...] = ()
    answers: tuple[int, ...] = ()
    left_out: tuple[str, ...] = ()

    @property
    def complete(self) -> bool:
        """Whether these inputs include all replies, so that the frame awaits no member."""
        return bool(self.answers)

    @property
    def without_replies(self) -> FrameInputs:
        """These inputs without the results of agents, so that hosts have to compute them again."""
        # Empty `answers` mark the inputs as incomplete, so the frame sends requests to its hosts.
        return replace(self, layout=(), replies=(), waiting={}, answers=(), left_out=())


@fast_dataclass
class RecordedFrame:
    """A frame of a recorded run.

    `events`: in order. `delta`: changes of the string, as plain data (log/entries.py).
    `digest`: of the string after the frame. `seconds`: when the frame ended, by the clock, since
    the record began. `inputs`: without the replies of hosts; None unless recorded and requested.
    """

    number: int
    events: tuple[AnyEvent, ...]
    delta: list[Any]
    digest: bytes
    seconds: float
    inputs: FrameInputs | None = None


HALTED: Final = "~halted"
"""Key in `Checkpoint.saved` for the agents whose actions the last views must not execute."""


@fast_dataclass
class Checkpoint:
    """State beside the string between two frames; `frame` is the next one.

    `saved`: data saved by members in step in their last complete frame, by member.
    `emitted`: events that agents sent, and `inbox`: events from other sources, by source; both
    count in the next frame.
    `reached`: agents that reached the event of `until`; `reaching`: kinds that can reach it.
    """

    frame: int = 0
    saved: Mapping[str, Mapping[str, Any]] = field(default_factory=dict[str, Mapping[str, Any]])
    emitted: tuple[AnyEvent, ...] = ()
    inbox: Mapping[str, tuple[AnyEvent, ...]] = field(
        default_factory=dict[str, tuple[AnyEvent, ...]]
    )
    reached: frozenset[str] = frozenset()
    reaching: frozenset[str] = frozenset()

    @property
    def sent(self) -> dict[str, tuple[AnyEvent, ...]]:
        """What agents and norms sent in the frame before, by source: events of the next frame."""
        return {AGENTS: self.emitted, SOURCE: self.inbox.get(SOURCE, ())}


# No member's name begins with ~, so these cannot be names of members.
EVERYONE: Final = "~all"
TICKED: Final = "~tick"
HOSTS: Final = "~hosts"


# --- stimuli, besides the messages of members ---


@fast_dataclass
class Appeared:
    """A member's liveliness token has appeared."""

    member: str


@fast_dataclass
class Vanished:
    """A member's liveliness token has disappeared."""

    member: str


@fast_dataclass
class Abandoned:
    """A member whose process is no longer restarted; the world continues without it."""

    member: str


@fast_dataclass
class Violation:
    """A member sent a message that the protocol does not allow."""

    member: str
    reason: str


@fast_dataclass
class Publish:
    """A person sends an event, or a batch; `person` is the name, if known."""

    event: AnyEvent
    person: str = ""


@fast_dataclass
class Drain:
    """Drain a host: other hosts take over its agents at the start of the next frame."""

    member: str


@fast_dataclass
class Skip:
    """Continue the frame without this member's reply; its agents keep their states."""

    member: str


@fast_dataclass
class Silent:
    """A period has passed without a reply: awaited members are late, or gone without a report."""


@fast_dataclass
class Begin:
    """The next frame may begin.

    `due` are the visual event types of devices with a rate that are due for a view now.
    `inputs` are logged inputs, which replace those of members that are absent.
    """

    due: tuple[str, ...] = ()
    inputs: FrameInputs | None = None


@fast_dataclass
class Seek:
    """Continue the replay of a record at this frame."""

    frame: int


@fast_dataclass
class End:
    """The world ends now; `failed`: prematurely, because of an error.

    `hurried`: the owner waits for the end, so members have little time for their last output.
    """

    reason: str
    failed: bool = False
    hurried: bool = False


Stimulus: TypeAlias = (
    FromMember
    | Appeared
    | Vanished
    | Abandoned
    | Violation
    | Publish
    | Drain
    | Skip
    | Silent
    | Begin
    | Seek
    | End
)


# --- instructions ---


@fast_dataclass
class Send:
    """Send a message to a member, or to `EVERYONE`, all that are `TICKED`, or all `HOSTS`."""

    to: str
    message: ToMember


@fast_dataclass
class Show:
    """Publish a view for all observers of its type, or for `to`, which needs another form."""

    event_type: str
    message: ToMember
    to: str = ""


@fast_dataclass
class Notify:
    """Notify observers of something about a member; `details` go to the log only."""

    member: str
    text: str
    details: str = ""


@fast_dataclass
class OrderJudged:
    """An order of a person is "accepted" in this frame, "rejected" by a norm, or "dropped".

    `by` is the norm, or the host that the frame ended twice; empty if the frame is computed again.
    """

    event: Event
    person: str
    frame: int
    state: str = "accepted"
    by: str = ""


@fast_dataclass
class Ready:
    """All required members are present, and no frame is in progress: send `Begin` when due."""

    frame: int


# Not frozen, because it keeps the record.
@dataclass(slots=True)
class FrameDone:
    """A frame is complete. `record` is computed on first access, before the next stimulus.

    It contains the digest of the whole string, whose cost only its readers should pay. The
    `inputs` are for the log.
    """

    frame: int
    make: Callable[[], FrameRecord]
    events: tuple[AnyEvent, ...] = ()
    inputs: FrameInputs | None = None
    _record: FrameRecord | None = None

    @property
    def record(self) -> FrameRecord:
        """The result of the frame; access it before the next stimulus."""
        # Several sinks read the record, which shows the string of now.
        if self._record is None:
            self._record = self.make()
        return self._record


@fast_dataclass
class Stopping:
    """No frame follows, for this reason; members send their reports and leave.

    `events` are those of frame `frame` that agents and norms have sent in the frame before.
    """

    reason: str
    frame: int
    events: tuple[AnyEvent, ...]


@fast_dataclass
class Ended:
    """The world has ended: each member's report has arrived, or the member is gone."""

    reason: str
    figures: Figures


Instruction: TypeAlias = Send | Show | Notify | OrderJudged | Ready | FrameDone | Stopping | Ended


class Instructions:
    """Instructions in the order of their execution; `pending` is their list."""

    def __init__(self, declines_columns: Callable[[str], bool]) -> None:
        """`declines_columns`: whether a member of this name does."""
        self._declines_columns = declines_columns
        self.pending: list[Instruction] = []

    def send(self, to: str, message: ToMember) -> None:
        """Send a message, without columns if the member declines them."""
        plain = self._declines_columns(to)
        self.pending.append(Send(to, plain_form(message) if plain else message))

    def log(self, member: str, text: str, details: str = "") -> None:
        """Log a line about a member; `details` appear in the log file only."""
        self.pending.append(Notify(member, text, details))


def plain_form(message: ToMember) -> ToMember:
    """The same message node by node, without columns; deltas must be applied before."""
    match message:
        case Fragments():
            return replace(message, given=_scenes(message.given))
        case EvolveRequest():
            return replace(message, events=_events(message.events), visual=_events(message.visual))
        case ViewShown():
            skeleton = None if message.skeleton is None else unfolded(message.skeleton)
            parts = _scenes(cast("Parts", message.parts))
            return replace(message, parts=parts, skeleton=skeleton)
        case Orders():
            return replace(message, events=_events(message.events))
        case _:
            return message


def _scenes(parts: Parts) -> Parts:
    return {name: unfolded(scene) for name, scene in parts.items()}


def _events(events: tuple[AnyEvent, ...]) -> tuple[AnyEvent, ...]:
    return tuple(single(events))
