"""What coordinator and members say to each other. PROTOCOL.md has the same on the wire."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, TypeAlias

from minerva_bus.grammar.batch import AnyEvent
from minerva_bus.grammar.patch import Delta
from minerva_bus.grammar.scene import Scene
from minerva_bus.grammar.symbols import AgentKind
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.world.readings import Reading

Figures: TypeAlias = Mapping[str, bool | int | float | str]
Parts: TypeAlias = Mapping[str, Scene]
Patches: TypeAlias = Mapping[str, Delta]
SentBy: TypeAlias = Mapping[str, tuple[AnyEvent, ...]]


# --- from a member to the coordinator ---


@dataclass(frozen=True, slots=True)
class Hello:
    """Who a member is and what it can do; the answer to `Greet`."""

    member: str
    version: int
    service: str = ""
    kinds: tuple[AgentKind, ...] = ()
    generates: tuple[str, ...] = ()
    lockstep: bool = False
    ahead: bool = False
    orders: tuple[str, ...] = ()
    draws: tuple[str, ...] = ()
    coupled: bool = False
    every: int = 0
    rate: float = 0.0
    topics: tuple[str, ...] = ()
    publishes: tuple[str, ...] = ()
    pid: int = 0
    host: str = ""
    people: bool = False
    """Whether what it generates counts as sent by people, as norms see it."""
    plain: bool = False
    """Whether it declines columns and patches: it gets nodes, events and views one by one."""

    @property
    def ticks(self) -> bool:
        """Whether this member is asked in the tick of every frame."""
        return self.lockstep or self.coupled

    @property
    def watches_only(self) -> bool:
        """Whether the world loses nothing but a view when this member is away."""
        return bool(self.draws) and not (self.kinds or self.generates or self.coupled)

    @property
    def roles(self) -> tuple[str, ...]:
        """The faces that it shows: agents, generator, device."""
        faces = (
            ("agents", self.kinds),
            ("generator", self.generates),
            ("device", self.draws),
        )
        return tuple(name for name, shown in faces if shown)


@dataclass(frozen=True, slots=True)
class TickReply:
    """C^d(t) of a lockstep member, and what a successor of it would need to go on.

    `heard` are the bytes that it came as, for a journal.
    """

    member: str
    frame: int
    events: tuple[AnyEvent, ...] = ()
    saved: Mapping[str, Any] | None = None
    heard: bytes = field(default=b"", compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class EvolveReply:
    """What became of a host's fragments in a frame: only what differs from what was there.

    `changed` maps a fragment to the string that replaces it, `patched` one in columns to what is
    different in it; `views` a visual event type to the changed views by fragment; `emitted` an
    agent, or a fragment in columns, to the events that it sent. `took` is how many seconds the
    answer was waited for, and `heard` the bytes that it came as, as who waited has them: they do
    not travel.
    """

    member: str
    frame: int
    part: int = 0
    changed: Parts = field(default_factory=dict[str, Scene])
    emitted: Mapping[str, tuple[AnyEvent, ...]] = field(
        default_factory=dict[str, tuple[AnyEvent, ...]]
    )
    views: Mapping[str, Parts] = field(default_factory=dict[str, Parts])
    patched: Patches = field(default_factory=dict[str, Delta])
    view_patches: Mapping[str, Patches] = field(default_factory=dict[str, Patches])
    took: float = 0.0
    heard: bytes = field(default=b"", compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Emitted:
    """Events of a free-running generator."""

    member: str
    events: tuple[AnyEvent, ...]


@dataclass(frozen=True, slots=True)
class Failed:
    """User code in a member raised; the member ends after this."""

    member: str
    frame: int
    problem: str
    traceback: str = ""


@dataclass(frozen=True, slots=True)
class Resync:
    """An observer missed a view and asks for a whole one."""

    member: str
    event_type: str


@dataclass(frozen=True, slots=True)
class Leaving:
    """A member goes of its own will."""

    member: str


@dataclass(frozen=True, slots=True)
class Doing:
    """How a member does meanwhile, in figures, for people who look."""

    member: str
    figures: Figures


@dataclass(frozen=True, slots=True)
class Report:
    """A member's figures for the summary; the answer to `Stop`."""

    member: str
    figures: Figures


# --- from the coordinator to members ---


@dataclass(frozen=True, slots=True)
class Greet:
    """Asks a member for its `Hello`."""


@dataclass(frozen=True, slots=True)
class Welcome:
    """A member is in: the world it has joined and the frame that comes next."""

    world: str
    vocabulary: Vocabulary
    seed: int
    dt: float
    frame: int
    policy: str = "sequential"
    saved: Mapping[str, Any] | None = None


@dataclass(frozen=True, slots=True)
class Refused:
    """A member may not join."""

    reason: str


@dataclass(frozen=True, slots=True)
class Sources:
    """Which members publish a sensor topic in step with the frames."""

    publishers: Mapping[str, tuple[str, ...]]


@dataclass(frozen=True, slots=True)
class TickRequest:
    """Steps 1 and 2 of Table 2: frame t begins, what are its events?"""

    frame: int


@dataclass(frozen=True, slots=True)
class Fragments:
    """Fragments that a host lacks, and those that it need not keep any longer."""

    given: Parts
    dropped: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class EvolveRequest:
    """Steps 5 and 6 of Table 2 for the hosts named in `asked`.

    `only` restricts it to some agents: those that came to a host in the midst of a frame.
    """

    frame: int
    asked: tuple[str, ...]
    events: tuple[AnyEvent, ...] = ()
    visual: tuple[AnyEvent, ...] = ()
    part: int = 0
    only: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class ViewShown:
    """π(w, e^v) for one visual event type: the string's static part and its agents' views.

    A *key* view is whole: `skeleton` is the string with each fragment as a mere `A#name()`, and
    `parts` has every fragment's view. Others have the changed parts only, those in columns as
    `patches` of what was there, and `sequence` tells whether one was missed.
    """

    frame: int
    event_type: str
    sequence: int
    parts: Parts
    skeleton: Scene | None = None
    patches: Patches = field(default_factory=dict[str, Delta])
    halted: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Orders:
    """What people have sent for a generator's event types, to count in a frame."""

    frame: int
    events: tuple[AnyEvent, ...]


@dataclass(frozen=True, slots=True)
class Repeat:
    """Asks a publisher for its last readings once more: somebody came too late for them."""

    topic: str


@dataclass(frozen=True, slots=True)
class Stop:
    """The world ends."""

    reason: str


# --- for all who listen ---


@dataclass(frozen=True, slots=True)
class Readings:
    """A member's readings on one topic; `frame` is -1 from a free-running publisher."""

    member: str
    topic: str
    frame: int
    readings: tuple[Reading, ...]


@dataclass(frozen=True, slots=True)
class FrameRecord:
    """What happened in a frame, for whoever watches: events in order, what became of agents.

    `changed` has the strings that took the place of outermost agents; `digest` is that of the
    string which the next frame begins with.
    """

    frame: int
    events: tuple[AnyEvent, ...]
    changed: Parts
    digest: bytes


FromMember: TypeAlias = (
    Hello | TickReply | EvolveReply | Emitted | Failed | Resync | Leaving | Doing | Report
)
ToMember: TypeAlias = (
    Greet
    | Welcome
    | Refused
    | Sources
    | TickRequest
    | Fragments
    | EvolveRequest
    | ViewShown
    | Orders
    | Repeat
    | Stop
)
Message: TypeAlias = FromMember | ToMember | Readings | FrameRecord
