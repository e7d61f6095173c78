"""Inputs and outputs of the frame algorithm: stimuli in, instructions out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, TypeAlias

from minerva_bus.frame.inputs import FrameInputs
from minerva_bus.frame.messages import (
    EvolveRequest,
    Figures,
    Fragments,
    FrameRecord,
    FromMember,
    Orders,
    Parts,
    ToMember,
    ViewShown,
    fast_dataclass,
)
from minerva_bus.grammar.columns import unfolded
from minerva_bus.grammar.events import AnyEvent, Event, single

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
    """An order of a person counts in this frame, or `norm` rejects it."""

    event: Event
    person: str
    frame: int
    norm: str = ""


@fast_dataclass
class Ready:
    """All required members are present, and no frame is in progress: send `Begin` when due."""

    frame: int


# Without slots, which `cached_property` does not support.
@dataclass(frozen=True)
class FrameDone:
    """A frame is complete. `record` is computed on first access, before the next stimulus.

    It contains the digest of the whole string, whose cost only its readers should pay. The
    `inputs` are for the log.
    """

    frame: int
    make: Callable[[], FrameRecord]
    events: tuple[AnyEvent, ...] = ()
    inputs: FrameInputs | None = None

    # Several sinks read the record, and the digest is computed once for all of them.
    @cached_property
    def record(self) -> FrameRecord:
        """The result of the frame; access it before the next stimulus."""
        return self.make()


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

    def add(self, instruction: Instruction) -> None:
        """Append an instruction."""
        self.pending.append(instruction)

    def send(self, to: str, message: ToMember) -> None:
        """Send a message, without columns if the member declines them."""
        plain = self._declines_columns(to)
        self.pending.append(Send(to, plain_form(message) if plain else message))

    def log(self, member: str, text: str, details: str = "") -> None:
        """Log a line about a member; `details` appear in the log file only."""
        self.pending.append(Notify(member, text, details))


def plain_form(message: ToMember) -> ToMember:
    """The same message node by node, without columns; patches must be applied before."""
    match message:
        case Fragments():
            return replace(message, given=_scenes(message.given))
        case EvolveRequest():
            return replace(message, events=_events(message.events), visual=_events(message.visual))
        case ViewShown():
            skeleton = None if message.skeleton is None else unfolded(message.skeleton)
            return replace(message, parts=_scenes(message.parts), skeleton=skeleton)
        case Orders():
            return replace(message, events=_events(message.events))
        case _:
            return message


def _scenes(parts: Parts) -> Parts:
    return {name: unfolded(scene) for name, scene in parts.items()}


def _events(events: tuple[AnyEvent, ...]) -> tuple[AnyEvent, ...]:
    return tuple(single(events))
