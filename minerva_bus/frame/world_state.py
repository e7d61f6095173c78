"""The state of a world: its declaration, its phase and the frame in flight, and what others read.

`WorldSpec` is the input of the frame algorithm before the first frame. `TRANSITIONS` is the literal
table of the phases of a world's life. Each frame starts with a new `FrameInFlight`. Only the frame
algorithm changes the state; others read it as `WorldProgress` or `StateToRecord`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Final, Protocol

from minerva_bus.errors import VocabularyError
from minerva_bus.frame import messages as m
from minerva_bus.frame.composition import Layout
from minerva_bus.frame.member_table import MemberEntry, Members
from minerva_bus.frame.messages import ViewShown
from minerva_bus.frame.placement import PlacementRules
from minerva_bus.frame.stimuli import DROPPED, Checkpoint, FrameInputs, OrdersBySource, Publish
from minerva_bus.grammar.columns import Delta
from minerva_bus.grammar.events import AnyEvent
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.scene import Scene, agents
from minerva_bus.grammar.vocabulary import EventType, Vocabulary
from minerva_bus.world.event_collection import Priority, collect
from minerva_bus.world.evolution import Policy
from minerva_bus.world.norms import Norm
from minerva_bus.world.population import newest_copy


@dataclass(frozen=True, slots=True)
class WorldSpec:
    """A world: its initial string w₀, its vocabulary and the rules of its frames.

    `dt`: simulated seconds per frame. The world ends after `frames` frames (0: no limit), when its
    string is ε, or when every agent of the kinds that send `until` has sent `until` or `give_up`.
    `real_time`: an external process, such as a robot, makes each frame last `dt` seconds.
    `norms`: the norms of the world. `people`: event types that people may send although a generator
    makes them. `speaks_for`: by generator, the kinds and `#id`s of agents in whose name it may send
    events. `shares`: by process, the generator whose agents it divides with others, or has alone.
    `placement`: which hosts may evolve which agents; it affects the string only if an
    agent has no host.

    A resumed world starts from the checkpoint `past` and the string of that frame; `shown` are the
    last views as keyframes, on which coupled devices still have to act.

    Raises VocabularyError if, under the literal policy, an agent has the id of a copy that a later
    frame may make.
    """

    name: str
    scene: Scene
    vocabulary: Vocabulary
    seed: int = 0
    dt: float = 0.1
    order: Priority = field(default_factory=Priority)
    policy: Policy = Policy.SEQUENTIAL
    frames: int = 0
    until: str = ""
    give_up: str = ""
    real_time: bool = False
    expected: frozenset[str] = frozenset()
    norms: tuple[Norm, ...] = ()
    people: tuple[str, ...] = ()
    speaks_for: Mapping[str, tuple[str, ...]] = field(default_factory=dict[str, tuple[str, ...]])
    shares: Mapping[str, str] = field(default_factory=dict[str, str])
    placement: PlacementRules = field(default_factory=PlacementRules)
    past: Checkpoint = field(default_factory=Checkpoint)
    shown: Sequence[ViewShown] = ()

    def __post_init__(self) -> None:
        # Ids of copies contain the frame that makes them. A string that already has
        # such an id of a later frame would then have two agents with one id.
        for agent in agents(self.scene) if self.policy.rules.makes_copies else ():
            frame = newest_copy((agent.id,))
            if frame >= self.past.frame:
                raise VocabularyError(
                    f"{agent.symbol}#{agent.id} has the id of a copy that frame {frame} makes"
                    f' under policy = "{self.policy.value}"',
                    expected="an id without :FRAME-NUMBER",
                    source=f"world {self.name}",
                )


class Phase(Enum):
    """Phase of a world; status displays show the value."""

    WAITING = "gathering members"
    READY = "between frames"
    TICK = "events"
    EVOLVE = "evolution"
    CLOSING = "last view"
    STOPPING = "reports"
    ENDED = "over"

    # Enum's own hash is a Python function, and each frame looks up three transitions.
    __hash__ = object.__hash__


class Awaited(Enum):
    """Condition that ends a phase; the value is its label in the drawing."""

    MEMBERS = "expected members present"
    BEGIN = "Begin"
    EVENTS = "generators answered"
    RESULTS = "hosts answered"
    OVER = "world over"
    REPORTS = "members reported"
    END = "End or failure"

    __hash__ = object.__hash__  # As above.


TRANSITIONS: Final[Mapping[tuple[Phase, Awaited], Phase]] = {
    (Phase.WAITING, Awaited.MEMBERS): Phase.READY,
    (Phase.READY, Awaited.BEGIN): Phase.TICK,
    (Phase.TICK, Awaited.EVENTS): Phase.EVOLVE,
    (Phase.EVOLVE, Awaited.RESULTS): Phase.READY,
    (Phase.EVOLVE, Awaited.OVER): Phase.CLOSING,
    (Phase.CLOSING, Awaited.RESULTS): Phase.STOPPING,
    (Phase.STOPPING, Awaited.REPORTS): Phase.ENDED,
    # A coordinator may crash between the last frame and the last view, so its successor shows it.
    (Phase.WAITING, Awaited.OVER): Phase.CLOSING,
    # A replay ends between two frames when its last viewer leaves.
    (Phase.READY, Awaited.OVER): Phase.CLOSING,
    (Phase.WAITING, Awaited.END): Phase.STOPPING,
    (Phase.READY, Awaited.END): Phase.STOPPING,
    (Phase.TICK, Awaited.END): Phase.STOPPING,
    (Phase.EVOLVE, Awaited.END): Phase.STOPPING,
    (Phase.CLOSING, Awaited.END): Phase.STOPPING,
    # A second interrupt does not wait for reports.
    (Phase.STOPPING, Awaited.END): Phase.ENDED,
}


Events = tuple[AnyEvent, ...]


# These four are no dataclasses: each frame makes them, and the factory of a field takes several
# times as long as a literal.
class FrameEvents:
    """Events of a frame (steps 2 to 4 of Table 2).

    `orders`: people's orders that generators take, by source; `permitted`: those that norms
    permit.
    `taken`: events from the inbox, by source; `people`: the sources that represent people.
    `due`: visual event types that devices generate in this frame.
    `allowed`: the events that count, by source; `dropped`: sources whose events are left out.
    `ordered`: e*, of which `visual` is e^v and `evolving` is e^u.
    """

    def __init__(self) -> None:
        self.orders: OrdersBySource = {}
        self.permitted: Events = ()
        self.taken: dict[str, Sequence[AnyEvent]] = {}
        self.people: tuple[str, ...] = ()
        self.due: tuple[str, ...] = ()
        self.allowed: Mapping[str, Sequence[AnyEvent]] = {}
        self.dropped: tuple[str, ...] = ()
        self.ordered: Events = ()
        self.visual: Events = ()
        self.evolving: Events = ()

    def split(self, events: Events, types: Mapping[str, EventType]) -> None:
        """Steps 3 and 4: the events of views, and those of evolution."""
        visual: list[AnyEvent] = []
        evolving: list[AnyEvent] = []
        for event in events:
            (visual if types[event.type].visual else evolving).append(event)
        self.ordered, self.visual, self.evolving = events, tuple(visual), tuple(evolving)


class Requests:
    """Requests to hosts in a frame (steps 5 and 6).

    `outstanding`: the fragments of each unanswered request, by host and part number. Part 0 is the
    first request; `repeats` counts the later ones, which concern some fragments only.
    `unassigned`: fragments that wait for a host to return.
    `left_out`: fragments that keep their state in this frame because no host answered for them.
    `reduced`: events and visual events of repeated requests after a norm rejected an outcome.
    `layout`: the division of populations at the time of the request.
    `deaths`: how often each host has ended while a request to it was unanswered.
    """

    def __init__(self) -> None:
        self.outstanding: dict[tuple[str, int], tuple[str, ...]] = {}
        self.repeats = 0
        self.unassigned: set[str] = set()
        self.left_out: set[str] = set()
        self.reduced: tuple[Events, Events] | None = None
        self.layout: Layout = ()
        self.deaths: dict[str, int] = {}

    @property
    def complete(self) -> bool:
        """Whether no request to a host is outstanding."""
        return not (self.outstanding or self.unassigned)

    def of(self, host: str) -> list[tuple[str, int]]:
        """Keys of a host's outstanding requests."""
        return [key for key in self.outstanding if key[0] == host]

    def cancel(self) -> None:
        """Cancel all outstanding requests."""
        self.outstanding, self.unassigned = {}, set()


class FrameResult:
    """Results of a frame (steps 5 and 6), as reported by hosts and later as permitted by norms.

    `replies`: the merged replies; `answers`: their number per request, for the log of inputs.
    `changed`: the replacement of each changed fragment; `changed_by`: the host that reported it.
    `sent`: events that agents sent. `newborns`: the fragment of each agent in a changed fragment;
    `born`: the ids that fragments in columns have gained.
    `views`: changed views by visual event type and fragment.
    `rejected`: fragments that differ from their hosts' reports because of a norm.
    `halted`: agents whose actions devices must not execute in this frame.
    """

    def __init__(self) -> None:
        self.replies: list[m.EvolveReply] = []
        self.answers: list[int] = []
        self.changed: dict[str, Scene] = {}
        self.changed_by: dict[str, str] = {}
        self.sent: dict[str, Events] = {}
        self.newborns: dict[str, str] = {}
        self.born: list[tuple[str, Ids]] = []
        self.views: dict[str, dict[str, Scene | Delta]] = {}
        self.rejected: tuple[str, ...] = ()
        self.halted: tuple[str, ...] = ()

    def merge(self, reply: m.EvolveReply, changed: m.Parts) -> None:
        """Add a host's reply; `changed` are its fragments with deltas applied."""
        self.replies.append(reply)
        self.changed.update(changed)
        self.sent.update(reply.emitted)
        for event_type, parts in reply.views.items():
            self.views.setdefault(event_type, {}).update(parts)


class FrameInFlight:
    """One frame, from `Begin` to its result.

    `clock_views`: visual event types whose devices request a view by the clock in this frame.
    `pending`: members whose tick reply the frame waits for in its phase TICK; `ticked`: replies by
    member.
    `logged`: inputs from a log, which replace those of absent members.
    """

    def __init__(
        self, clock_views: tuple[str, ...] = (), logged: FrameInputs | None = None
    ) -> None:
        self.clock_views = clock_views
        self.logged = logged
        self.pending: set[str] = set()
        self.ticked: dict[str, m.TickReply] = {}
        self.events = FrameEvents()
        self.requests = Requests()
        self.result = FrameResult()

    def leave_out(
        self, sources: Sequence[str], order: Priority, types: Mapping[str, EventType]
    ) -> None:
        """Leave all events of some sources out of the frame; its inputs keep them apart."""
        events = self.events
        for source in sources:
            reply, sent = self.ticked.get(source), events.taken.pop(source, ())
            if reply is not None:
                sent = [*reply.events, *sent]
                self.ticked[source] = replace(reply, events=(), received=b"")
            events.taken[DROPPED + source] = sent
        events.dropped = tuple(sources)
        left = {name: sent for name, sent in events.allowed.items() if name not in sources}
        events.allowed = left
        events.split(collect(order, left), types)


class Progress:
    """Where a world is: its phase, and the frame in flight, or the next one.

    `frame` is its number, which `EvolutionStep.commit` raises; `FrameAlgorithm` changes the others.
    """

    __slots__ = ("frame", "in_flight", "phase")

    def __init__(self, frame: int) -> None:
        self.phase = Phase.WAITING
        self.frame = frame
        self.in_flight = FrameInFlight()

    def enter(self, awaited: Awaited) -> None:
        """Continue with the phase that follows this condition."""
        self.phase = TRANSITIONS[self.phase, awaited]


class InputSteps(Protocol):
    """Steps 2 to 4 of Table 2: what asks for the events of a frame, and takes them.

    `tick_reply` and `emitted` return the reason if a message violates the protocol, or "".
    """

    def begin(self) -> None:
        """Request the events of the frame that begins."""
        ...

    def tick_reply(self, reply: m.TickReply) -> str:
        """Accept C^d(t) of a generator in step."""
        ...

    def emitted(self, emitted: m.Emitted) -> str:
        """Accept events of a free-running generator."""
        ...

    def order(self, order: Publish) -> None:
        """Accept an event from a person."""
        ...

    def ask(self, member: MemberEntry) -> None:
        """Repeat the request to a generator that has returned while the frame waits for it."""
        ...

    def collect(self) -> None:
        """The events of the frame."""
        ...


class OutcomeSteps(Protocol):
    """Steps 5, 6 and 8 of Table 2: what asks for the results of a frame, and takes them."""

    def evolve(self) -> None:
        """Steps 5 and 6: request the next string and the views."""
        ...

    def reply(self, reply: m.EvolveReply) -> str:
        """Accept a host's results; returns the reason for a violation, or ""."""
        ...

    def ask_again(self, fragments: list[str]) -> None:
        """Request fragments once more, because their host is gone, or one has returned."""
        ...

    def lighten(self, host: str) -> bool:
        """Repeat a frame that has ended a host twice by fewer events; False if it cannot."""
        ...

    def settle(self) -> bool:
        """Whether the results are final, with norms applied; otherwise more are requested."""
        ...

    def commit(self) -> None:
        """Step 8: w = w_next and t = t + 1."""
        ...


class WorldProgress(Protocol):
    """What pacing, metrics and displays read: how far a world is, and with whom."""

    @property
    def world(self) -> WorldSpec:
        """The world as declared."""
        ...

    @property
    def members(self) -> Members:
        """Its members."""
        ...

    @property
    def frame(self) -> int:
        """The number of the frame in flight, or of the next one."""
        ...

    @property
    def phase(self) -> Phase:
        """The phase of the world."""
        ...

    @property
    def in_frame(self) -> bool:
        """Whether a frame is in progress."""
        ...

    @property
    def at_rest(self) -> bool:
        """Whether the next frame would change neither the string nor any view."""
        ...


class StateToRecord(WorldProgress, Protocol):
    """What a record, a journal or a table also keeps between two frames."""

    @property
    def scene(self) -> Scene:
        """The string w."""
        ...

    @property
    def checkpoint(self) -> Checkpoint:
        """State besides the string from which the world can resume."""
        ...

    @property
    def shown(self) -> list[ViewShown]:
        """The latest view of each visual event type, as a keyframe."""
        ...

    @property
    def closing_events(self) -> Sequence[AnyEvent]:
        """What agents and norms sent in the last complete frame: events of the next one."""
        ...
