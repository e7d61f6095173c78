"""What the frame algorithm is told, and what it tells to do: its whole contact with the world."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Final, TypeAlias

from minerva_bus.frame.inputs import FrameInputs
from minerva_bus.frame.messages import Figures, FrameRecord, FromMember, ToMember
from minerva_bus.grammar.batch import AnyEvent
from minerva_bus.grammar.events import Event

EVERYONE: Final = "~all"
TICKED: Final = "~tick"
HOSTS: Final = "~hosts"


# --- in, beside what members send ---


@dataclass(frozen=True, slots=True)
class Appeared:
    """A member's liveliness token is there."""

    member: str


@dataclass(frozen=True, slots=True)
class Vanished:
    """A member's liveliness token is gone."""

    member: str


@dataclass(frozen=True, slots=True)
class GaveUp:
    """Nobody will start this member again; go on without it."""

    member: str


@dataclass(frozen=True, slots=True)
class Violation:
    """A member sent what the protocol does not allow."""

    member: str
    reason: str


@dataclass(frozen=True, slots=True)
class Order:
    """A person sends an event."""

    event: Event


@dataclass(frozen=True, slots=True)
class Drain:
    """A host shall be emptied: others take its agents over at the next frame's edge."""

    member: str


@dataclass(frozen=True, slots=True)
class Skip:
    """The frame shall go on without this member's answer; its agents stand still."""

    member: str


@dataclass(frozen=True, slots=True)
class Silent:
    """Time has passed: those who are being waited for are late, or gone without a report."""


@dataclass(frozen=True, slots=True)
class Begin:
    """The next frame may begin.

    `due` are the visual event types whose devices want a view by the clock, and now is the time.
    `inputs` are logged ones, which count in place of those of members that are not here.
    """

    due: tuple[str, ...] = ()
    inputs: FrameInputs | None = None


@dataclass(frozen=True, slots=True)
class Seek:
    """What is played again shall go on with this frame."""

    frame: int


@dataclass(frozen=True, slots=True)
class End:
    """The world shall end now; `failed`: before its time, because something went wrong.

    `hurried`: its owner waits for the end, so members have little time for their last output.
    """

    reason: str
    failed: bool = False
    hurried: bool = False


Stimulus: TypeAlias = (
    FromMember
    | Appeared
    | Vanished
    | GaveUp
    | Violation
    | Order
    | Drain
    | Skip
    | Silent
    | Begin
    | Seek
    | End
)


# --- out ---


@dataclass(frozen=True, slots=True)
class Send:
    """Send a message to a member, or to everyone, all who are ticked, or all hosts of agents."""

    to: str
    message: ToMember


@dataclass(frozen=True, slots=True)
class Show:
    """Publish a view for the observers of its event type, or for one that wants another form."""

    event_type: str
    message: ToMember
    to: str = ""


@dataclass(frozen=True, slots=True)
class Say:
    """Tell the people who watch: about whom, and what; `details` are for the log only."""

    member: str
    text: str
    details: str = ""


@dataclass(frozen=True, slots=True)
class Ready:
    """All who are needed are there and no frame is under way: send `Begin` when it is time."""

    frame: int


@dataclass(frozen=True)
class FrameDone:
    """A frame is over. `record` is made when it is asked for, which is now or never.

    It has the digest of the whole string, which nobody need pay for who does not want it. The
    `inputs` are for the log.
    """

    frame: int
    make: Callable[[], FrameRecord]
    events: tuple[AnyEvent, ...] = ()
    inputs: FrameInputs | None = None

    @cached_property
    def record(self) -> FrameRecord:
        """What happened in the frame; to be asked for before the next stimulus."""
        return self.make()


@dataclass(frozen=True, slots=True)
class Stopping:
    """No frame follows, for this reason; members are asked for their reports and go."""

    reason: str


@dataclass(frozen=True, slots=True)
class Ended:
    """The world is over, and all reports are in or cannot come any more."""

    reason: str
    figures: Figures


Instruction: TypeAlias = Send | Show | Say | Ready | FrameDone | Stopping | Ended
