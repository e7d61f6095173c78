"""Every message between coordinator and members, declared once: types, limits and meaning.

A message is a frozen dataclass with a `WIRE`. Its fields are encoded by type, in the order of
declaration; marks beside a type restrict a field or determine where its value is sent:

    count: Annotated[int, AtLeast(1), Note("how many")]

`minerva_bus.wire` compiles encoders, decoders and the tables of PROTOCOL.md from this.

To add a message: declare it here, add it to `FromMember` or `ToMember`, and handle it in
`frame/algorithm.py` or `frame/member_side.py`. To add a field to `Hello`: declare it, `OPTIONAL`.
`python -m tools.protocol_tables --write` updates PROTOCOL.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from enum import Enum, auto
from typing import Annotated, Any, ClassVar, Final, TypeAlias

from minerva_bus.grammar.columns import Delta
from minerva_bus.grammar.events import AnyEvent
from minerva_bus.grammar.scene import Scene
from minerva_bus.grammar.vocabulary import AgentKind, Vocabulary
from minerva_bus.values import fast_dataclass
from minerva_bus.world.evolution import Policy
from minerva_bus.world.readings import Reading
from minerva_bus.world.services import Participation, When


@fast_dataclass
class Wire:
    """Form of a message: `[name, item, ...]`, or `[name, {field: value}]` if `keyed`.

    `on`: keys on which it is published. `answers`: the message to which it replies.
    `max_bytes`, `max_values`: names of the limits (`wire/plain.py`) if a member sends it.
    `awaited`: a frame may wait for it, so it is exempt from limits per second.
    """

    name: str
    on: tuple[str, ...]
    meaning: str
    answers: str = ""
    keyed: bool = False
    max_bytes: str = "small_bytes"
    max_values: str = "values"
    awaited: bool = False


@fast_dataclass
class AtLeast:
    """Minimum of a number; the default is 0 for an int, and none for a float."""

    value: int


@fast_dataclass
class AtMost:
    """Maximum number of values in a list or map: the name of a field of Limits."""

    limit: str


@fast_dataclass
class Note:
    """Description of a field in PROTOCOL.md."""

    text: str


class Mark(Enum):
    """Properties of a field that do not follow from its type."""

    FROM_KEY = auto()
    """Not in the message: part of the key on which it is published."""

    LOCAL = auto()
    """Not in the message: set by the receiving process."""

    OPTIONAL = auto()
    """May be missing in a keyed message; then its default applies."""

    TOPICS = auto()
    """Names of sensor topics, which are parts of keys."""

    EVENT_TYPES = auto()
    """Names of event types."""

    SHOWN = auto()
    """Texts that are shown to people, on one line."""

    GENERATED = auto()
    """Events of a generator, of which only a limited number may be outside columns."""

    EMITTED = auto()
    """Events of agents, of which only a limited total may be outside columns."""

    VIEW = auto()
    """Strings without agents."""

    SLOTS = auto()
    """A string whose agents have no state and no scope."""


Figures: TypeAlias = Mapping[str, bool | int | float | str]
Parts: TypeAlias = Mapping[str, Scene]
Changes: TypeAlias = Mapping[str, Scene | Delta]
"""Strings by id; of a part in columns that the receiver has, the delta."""

SentBy: TypeAlias = Mapping[str, tuple[AnyEvent, ...]]

Sender: TypeAlias = Annotated[str, Mark.FROM_KEY]
Topics: TypeAlias = Annotated[tuple[str, ...], AtMost("names"), Mark.TOPICS]
EventTypes: TypeAlias = Annotated[tuple[str, ...], AtMost("names"), Mark.EVENT_TYPES]
GeneratedEvents: TypeAlias = Annotated[tuple[AnyEvent, ...], Mark.GENERATED]
Saved: TypeAlias = Mapping[str, Any] | None
Received: TypeAlias = Annotated[bytes, Mark.LOCAL]

SAVED_VALUE: Final = "="
"""Key of saved data that are not a mapping."""

NOTHING_SAVED: Final[Mapping[str, Any]] = {SAVED_VALUE: None}
"""Replaces a member's earlier data when it no longer saves any."""

PROTOCOL_VERSION = 7

NO_WHEN: Final = When()

_NO_FRAME: Final = AtLeast(-1)
_POLICIES: Final = Note(" or ".join(f"`{policy.value}`" for policy in Policy))


# --- from a member to the coordinator ---


@fast_dataclass
class Hello:
    """Roles and capabilities of a member, and when it takes part; the answer to `Greet`."""

    # A map, so that keys can be added without a new version of the
    # protocol (PROTOCOL.md, section 16).
    WIRE: ClassVar = Wire("hello", ("from",), "what it is: a map, see below", "greet", keyed=True)

    member: Sender
    version: Annotated[int, Note(str(PROTOCOL_VERSION))]
    kinds: Annotated[
        tuple[AgentKind, ...],
        AtMost("kinds"),
        Note("the kinds of agents that it evolves, with the world's names and types of attributes"),
    ] = ()
    generates: Annotated[
        EventTypes, Note("the event types that it may send; any other violates the protocol")
    ] = ()
    when: Annotated[
        When, Note("when it takes part in frames, see [section 7](#when-a-member-takes-part)")
    ] = NO_WHEN
    orders: Annotated[EventTypes, Note("the event types for which it takes people's orders")] = ()
    people: Annotated[
        bool, Mark.OPTIONAL, Note("norms treat the events that it generates as sent by people")
    ] = False
    draws: Annotated[EventTypes, Note("the visual event types whose views it draws")] = ()
    coupled: Annotated[
        bool, Note("a device that executes each view before the next frame's events")
    ] = False
    topics: Annotated[Topics, Note("the topics to which it subscribes")] = ()
    publishes: Annotated[Topics, Note("the topics on which it publishes")] = ()
    plain: Annotated[
        bool,
        Mark.OPTIONAL,
        Note("it declines columns and patches, see [section 9](#members-that-decline-columns)"),
    ] = False
    about: Annotated[
        Figures,
        AtMost("figures"),
        Mark.SHOWN,
        Note("for people: `service`, what it is; `pid`, its process; `host`, its machine"),
    ] = field(default_factory=dict[str, bool | int | float | str])

    @property
    def service(self) -> str:
        """What it is, for people."""
        return str(self.about.get("service", ""))

    @property
    def pid(self) -> int:
        """Its process; 0 if it is not known.

        Ids below 2 mean all processes, a group or the first process of a container to `kill`.
        """
        pid = self.about.get("pid", 0)
        return pid if isinstance(pid, int) and pid > 1 else 0

    @property
    def host(self) -> str:
        """Its machine."""
        return str(self.about.get("host", ""))

    @property
    def ticks(self) -> bool:
        """Whether frames wait for the answers of this member."""
        return self.when.is_awaited or self.coupled

    @property
    def is_on_orders(self) -> bool:
        """Whether it is asked for events in frames with orders only."""
        return self.when.asked is Participation.ON_ORDERS

    @property
    def interval(self) -> int:
        """The frames from one request of a generator that draws nothing to the next, or 0."""
        return 0 if self.draws or self.coupled else self.when.every

    @property
    def ticks_with_all(self) -> bool:
        """Whether one message asks this member and others in each frame."""
        return self.ticks and not self.is_on_orders and not self.interval

    @property
    def watches_only(self) -> bool:
        """Whether the world lacks only a view when this member is away."""
        return bool(self.draws) and not (self.kinds or self.generates or self.coupled)

    @property
    def roles(self) -> tuple[str, ...]:
        """Its roles among `agents`, `generator` and `device`."""
        roles = (("agents", self.kinds), ("generator", self.generates), ("device", self.draws))
        return tuple(name for name, offered in roles if offered)


@fast_dataclass
class TickReply:
    """C^d(t) of a member in step, and the data from which a successor continues.

    `received`: the message as received, for a journal.
    """

    WIRE: ClassVar = Wire(
        "ticked",
        ("from",),
        "its events of the frame",
        "tick",
        max_bytes="tick_bytes",
        max_values="tick_values",
        awaited=True,
    )

    member: Sender
    frame: int
    events: GeneratedEvents = ()
    saved: Saved = None
    # Not compared: in an in-process run the same message has no bytes.
    received: Received = field(default=b"", compare=False, repr=False)


@fast_dataclass
class EvolveReply:
    """The changes of a host's fragments and views in a frame.

    `changed`: the string that replaces each fragment, or its delta. `views`: changed views by
    visual event type and fragment. `emitted`: the events sent by each agent or fragment in columns.
    `elapsed`: seconds that the coordinator waited for the reply. `received`: the message as
    received.
    """

    WIRE: ClassVar = Wire(
        "evolved",
        ("from",),
        "what has changed",
        "evolve",
        max_bytes="message_bytes",
        max_values="answer_values",
        awaited=True,
    )

    member: Sender
    frame: int
    part: int = 0
    changed: Changes = field(default_factory=dict[str, Scene | Delta])
    emitted: Annotated[SentBy, Mark.EMITTED] = field(
        default_factory=dict[str, tuple[AnyEvent, ...]]
    )
    views: Annotated[Mapping[str, Changes], Mark.VIEW] = field(default_factory=dict[str, Changes])
    elapsed: Annotated[float, Mark.LOCAL] = 0.0
    received: Received = field(default=b"", compare=False, repr=False)


@fast_dataclass
class Emitted:
    """Events of a free-running generator."""

    WIRE: ClassVar = Wire(
        "emitted", ("from",), "events of a free-running generator", max_bytes="emitted_bytes"
    )

    member: Sender
    events: GeneratedEvents


@fast_dataclass
class Failed:
    """User code in a member raised an exception; the member then ends."""

    WIRE: ClassVar = Wire(
        "failed",
        ("from",),
        "its own code failed. Ten lines of the problem are shown; the traceback goes to the log",
    )

    member: Sender
    frame: Annotated[int, _NO_FRAME, Note("−1: none yet")]
    problem: str
    traceback: str = ""


@fast_dataclass
class Resync:
    """An observer missed a view and requests a keyframe."""

    WIRE: ClassVar = Wire("resync", ("from",), "an observer missed a view and requests a key view")

    member: Sender
    event_type: str


@fast_dataclass
class Leaving:
    """A member leaves voluntarily."""

    WIRE: ClassVar = Wire("leaving", ("from",), "it leaves")

    member: Sender


@fast_dataclass
class MemberMetrics:
    """A member's current metrics, for displays."""

    WIRE: ClassVar = Wire(
        # The name on the wire differs from the class, because another one would need a new version.
        "doing",
        ("from",),
        "the member's metrics, for displays; sent when they have changed, at most once per second",
    )

    member: Sender
    figures: Annotated[Figures, AtMost("figures")]


@fast_dataclass
class Report:
    """A member's metrics for the summary; the answer to `Stop`."""

    WIRE: ClassVar = Wire(
        "report",
        ("from",),
        "for the summary; numbers of one name from several members are added",
        "stop",
        awaited=True,
    )

    member: Sender
    figures: Annotated[Figures, AtMost("figures")]


# --- from the coordinator to members ---


@fast_dataclass
class Greet:
    """Request a member's `Hello`."""

    WIRE: ClassVar = Wire("greet", ("to",), "send `hello`")


@fast_dataclass
class Welcome:
    """A member has joined: its world, and the next frame."""

    WIRE: ClassVar = Wire("welcome", ("to",), "it has joined")

    world: str
    vocabulary: Vocabulary
    seed: Annotated[int, AtLeast(-(1 << 63))]
    dt: Annotated[float, Note("seconds of a frame")]
    frame: Annotated[int, Note("the next one, or the one in progress")]
    policy: Annotated[str, _POLICIES] = "sequential"
    saved: Annotated[Saved, Note("what a predecessor of this name saved last")] = None


@fast_dataclass
class Refused:
    """A member may not join."""

    WIRE: ClassVar = Wire(
        "refused", ("to",), "it may not join, or has violated the protocol; it ends"
    )

    reason: str


@fast_dataclass
class Sources:
    """The publishers in step of each sensor topic."""

    WIRE: ClassVar = Wire(
        "sources", ("to", "all"), "by topic, the members that publish it in step with the frames"
    )

    publishers: Mapping[str, tuple[str, ...]]


@fast_dataclass
class TickRequest:
    """Steps 1 and 2 of Table 2: frame t begins; request its events."""

    WIRE: ClassVar = Wire("tick", ("tick", "to"), "requests the events of the frame")

    frame: int


@fast_dataclass
class Fragments:
    """Fragments that a host lacks, and those that it no longer needs."""

    WIRE: ClassVar = Wire(
        "fragments", ("to",), "fragments to evolve from now on, and fragments to discard"
    )

    given: Parts
    dropped: tuple[str, ...] = ()


@fast_dataclass
class EvolveRequest:
    """Steps 5 and 6 of Table 2 for the hosts named in `asked`.

    `only` restricts it to fragments that were assigned to a host during the frame.
    """

    WIRE: ClassVar = Wire(
        "evolve", ("evolve", "to"), "evolves the fragments in `only`, or all where it is empty"
    )

    frame: int
    asked: Annotated[tuple[str, ...], Note("members")]
    events: tuple[AnyEvent, ...] = ()
    visual: tuple[AnyEvent, ...] = ()
    part: int = 0
    only: Annotated[tuple[str, ...], Note("ids")] = ()


@fast_dataclass
class ViewShown:
    """π(w, e^v) for one visual event type: the string's static part and its agents' views.

    A *key* view is complete: `skeleton` is the string with each fragment as a slot `A#name()`, and
    `parts` has the view of every fragment. Other views have only the changed parts, those in
    columns as deltas of the previous ones; a gap in `sequence` means that a view was missed.
    """

    WIRE: ClassVar = Wire(
        "view",
        ("view", "to"),
        "what to draw. The steps of `halted` agents do not count in this frame: a device executes"
        " no action for them",
    )

    event_type: str
    frame: int
    sequence: int
    parts: Annotated[Changes, Mark.VIEW]
    skeleton: Annotated[Scene | None, Mark.SLOTS] = None
    halted: Annotated[tuple[str, ...], Note("ids")] = ()


@fast_dataclass
class Orders:
    """Events sent by people for the event types that a generator takes, for a frame."""

    WIRE: ClassVar = Wire(
        "orders",
        ("to",),
        "events of people for this frame, of the types for which the member takes orders",
    )

    frame: int
    events: tuple[AnyEvent, ...]


@fast_dataclass
class Repeat:
    """Request a publisher's last readings again, for a subscriber that has just joined."""

    WIRE: ClassVar = Wire("repeat", ("to",), "publish the last readings again, unchanged")

    topic: str


@fast_dataclass
class Stop:
    """The world ends."""

    WIRE: ClassVar = Wire("stop", ("all", "to"), "the world ends")

    reason: str


# --- for all subscribers ---


@fast_dataclass
class Readings:
    """A member's readings on one topic; `frame` is -1 if the publisher is free-running."""

    WIRE: ClassVar = Wire("readings", ("topic",), "what a publisher has measured")

    member: Sender
    topic: Annotated[str, Mark.FROM_KEY]
    frame: Annotated[int, _NO_FRAME, Note("−1: from a free-running publisher")]
    readings: tuple[Reading, ...]


@fast_dataclass
class FrameRecord:
    """The result of a frame, for watchers: its events in order, and its changes.

    `changed`: the strings that replaced fragments. `digest`: that of the string with which the next
    frame begins.
    """

    WIRE: ClassVar = Wire("frame", ("record",), "the result of a frame")

    frame: int
    events: tuple[AnyEvent, ...]
    changed: Parts
    digest: bytes


FromMember: TypeAlias = (
    Hello | TickReply | EvolveReply | Emitted | Failed | Resync | Leaving | MemberMetrics | Report
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
