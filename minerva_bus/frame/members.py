"""The members of a world: the table of their states, their roles, and how they join and leave.

       appeared          greeted           admitted
(none) ────────▶ JOINING ───────▶ JOINING ────────▶ PRESENT ◀──▶ LATE
                    ▲                                  │ vanished  │
                    │ appeared                         ▼           ▼
                   LEFT ◀─── gave up, or left ──────── LOST ◀──────

A member that leaves of its own accord sends `Leaving`, and its token vanishes. Either may arrive
first, because Zenoh delivers token changes before data.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import TYPE_CHECKING, Any, Final

from minerva_bus.errors import nearest
from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.in_flight import Phase
from minerva_bus.frame.inputs import AGENTS, FrameInputs, is_people
from minerva_bus.frame.messages import PROTOCOL_VERSION, Figures, Hello
from minerva_bus.frame.orders import refusal_of_guest
from minerva_bus.grammar.symbols import AgentKind
from minerva_bus.grammar.types import Type
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.world.services import Participation, objection

if TYPE_CHECKING:
    from minerva_bus.frame.algorithm import FrameAlgorithm


class MemberState(Enum):
    """State of a member."""

    JOINING = "joining"
    PRESENT = "present"
    LATE = "late"
    LOST = "lost"
    LEFT = "left"


class MemberChange(Enum):
    """Events in the life of a member."""

    APPEARED = "appeared"
    ADMITTED = "admitted"
    SILENT = "silent"
    ANSWERED = "answered"
    VANISHED = "vanished"
    GAVE_UP = "gave up"
    WENT = "went"


TRANSITIONS: Final[Mapping[tuple[MemberState, MemberChange], MemberState]] = {
    (MemberState.JOINING, MemberChange.ADMITTED): MemberState.PRESENT,
    (MemberState.JOINING, MemberChange.VANISHED): MemberState.LOST,
    (MemberState.JOINING, MemberChange.WENT): MemberState.LEFT,
    (MemberState.PRESENT, MemberChange.SILENT): MemberState.LATE,
    (MemberState.PRESENT, MemberChange.VANISHED): MemberState.LOST,
    (MemberState.PRESENT, MemberChange.WENT): MemberState.LEFT,
    (MemberState.LATE, MemberChange.ANSWERED): MemberState.PRESENT,
    (MemberState.LATE, MemberChange.VANISHED): MemberState.LOST,
    (MemberState.LATE, MemberChange.WENT): MemberState.LEFT,
    (MemberState.LOST, MemberChange.APPEARED): MemberState.JOINING,
    (MemberState.LOST, MemberChange.GAVE_UP): MemberState.LEFT,
    # The token vanished first and `Leaving` arrives after it.
    (MemberState.LOST, MemberChange.WENT): MemberState.LEFT,
    (MemberState.LEFT, MemberChange.APPEARED): MemberState.JOINING,
}


@dataclass(slots=True)
class MemberEntry:
    """One member: a row of the table `Members`.

    `expected`: the world file names it, so the world waits for it until it is given up.
    `greeted`: `hello` is from the current process, not from one before it.
    `late`: number of replies that arrived too late to count.
    `drained`: it hosts no agents that another host can evolve.
    `dropped`: number of its events that were discarded.
    `figures`: its metrics, as it last reported them.
    `joins`: number of times a process of this name has joined.
    `blamed`: a violation was logged since it appeared.
    `rests`: if it is asked on orders, it need not be asked before it gets some.
    """

    name: str
    expected: bool = False
    state: MemberState = MemberState.LEFT
    hello: Hello | None = None
    greeted: bool = False
    last_reply: int = -1
    late: int = 0
    drained: bool = False
    dropped: int = 0
    figures: Figures = field(default_factory=dict[str, bool | int | float | str])
    joins: int = 0
    blamed: bool = False
    rests: bool = False

    def change(self, change: MemberChange) -> bool:
        """Apply the transition table; False if it has no such transition."""
        after = TRANSITIONS.get((self.state, change))
        if after is not None:
            self.state = after
        return after is not None

    @property
    def ticks(self) -> bool:
        """Whether frames wait for its answers to ticks."""
        return self.hello is not None and self.hello.ticks

    @property
    def active(self) -> bool:
        """Whether it takes part in frames."""
        return self.state in (MemberState.PRESENT, MemberState.LATE)

    @property
    def needed(self) -> bool:
        """Whether frames require it. A member that only watches is required until it joins."""
        return self.expected and not (self.hello is not None and self.hello.watches_only)

    @property
    def awaited(self) -> bool:
        """Whether the world waits for it to join or to return."""
        return self.needed and self.state in (MemberState.JOINING, MemberState.LOST)


MAX_DEPARTED: Final = 200
"""Guests that remain in the table after leaving; the oldest is removed first."""

_NONE: Final = frozenset[str]()


@dataclass(frozen=True, slots=True)
class MemberIndex:
    """Members by role, computed once per change of the table because each frame needs it.

    `tickers` answer ticks; `sources` are the devices that generate their own visual events.
    Both include members that are away and awaited. `on_orders` receive a tick in frames with orders
    only, `at_intervals` in the frames that a number divides; `joining` are to be admitted.
    `anyone_ticks`: the tick for all has a recipient. `rates` maps the visual event types of devices
    that request views by the clock to views per second. Any other device gets a view within `every`
    frames.
    """

    active: tuple[MemberEntry, ...]
    awaited: tuple[MemberEntry, ...]
    joining: tuple[MemberEntry, ...]
    tickers: frozenset[str]
    anyone_ticks: bool
    on_orders: tuple[MemberEntry, ...]
    at_intervals: tuple[tuple[MemberEntry, int], ...]
    sources: tuple[Hello, ...]
    rates: Mapping[str, float]
    every: int


class Members:
    """Members by name, and queries over them; iteration is sorted by name."""

    def __init__(self, expected: Iterable[str]) -> None:
        self._entries = {
            name: MemberEntry(name, expected=True, state=MemberState.LOST)
            for name in sorted(expected)
        }
        # The processes of the world file, kept apart because
        # `expected` changes while the world runs.
        self._named = frozenset(self._entries)
        self._departed: dict[str, None] = {}
        self._index: MemberIndex | None = None
        self.publishers: dict[str, tuple[str, ...]] = {}
        """The publishers in step of each sensor topic, as last announced to all members."""
        self.saved: dict[str, Mapping[str, Any]] = {}
        """Data saved by members in their last complete frame; ~names are the coordinator's."""
        self.strangers: int = 0
        """Number of messages from senders that never appeared."""

    def __iter__(self) -> Iterator[MemberEntry]:
        return iter([self._entries[name] for name in sorted(self._entries)])

    @property
    def count(self) -> int:
        """Number of members that have appeared or are expected, without those that have left."""
        return len(self._entries) - len(self._departed)

    def knows(self, name: str) -> bool:
        """Whether a member of this name is expected or has ever appeared."""
        return name in self._entries

    def get(self, name: str) -> MemberEntry:
        """The member of a name; creates its entry if necessary."""
        member = self._entries.get(name)
        if member is None:
            member = self._entries[name] = MemberEntry(name)
            self._index = None
            self._note_departed(member)
        return member

    # --- changes ---

    def change(self, member: MemberEntry, change: MemberChange) -> bool:
        """Apply the transition table to a member; False if it has no such transition."""
        self._index = None
        if change is MemberChange.APPEARED:
            # The hello of a former process must not answer the greeting of this one.
            member.greeted = False
        moved = member.change(change)
        self._note_departed(member)
        return moved

    def _note_departed(self, member: MemberEntry) -> None:
        # Guests can use any number of names, so the table keeps only the latest of those that left.
        self._departed.pop(member.name, None)
        if member.state is MemberState.LEFT and not member.expected:
            self._departed[member.name] = None
        if len(self._departed) > MAX_DEPARTED:
            first = next(iter(self._departed))
            del self._departed[first]
            self._entries.pop(first, None)
            self.saved.pop(first, None)

    def expect(self, name: str) -> None:
        """Wait for a member of this name to join or return."""
        member = self.get(name)
        if not member.expected:
            member.expected, member.state = True, MemberState.LOST
            self._index = None
            self._note_departed(member)

    def stop_expecting(self, member: MemberEntry) -> None:
        """Stop waiting for a member."""
        self._index = None
        member.expected = False
        self._note_departed(member)

    def introduce(self, member: MemberEntry, hello: Hello) -> None:
        """Store the hello of a process that has just started."""
        self._index = None
        member.hello, member.greeted, member.drained = hello, True, False
        member.rests = False
        member.joins += 1

    # --- queries ---

    @property
    def index(self) -> MemberIndex:
        """Members by role."""
        if self._index is None:
            self._index = self._make_index()
        return self._index

    def _make_index(self) -> MemberIndex:
        # By name, so that no order of messages or events depends on the order of joining.
        members = list(self)
        tickers = [m for m in members if m.ticks and (m.active or m.awaited)]
        hellos = [m.hello for m in members if m.hello is not None and (m.active or m.awaited)]
        return MemberIndex(
            active=tuple(m for m in members if m.active),
            awaited=tuple(m for m in members if m.awaited),
            joining=tuple(m for m in members if m.state is MemberState.JOINING and m.greeted),
            tickers=frozenset(m.name for m in tickers),
            anyone_ticks=any(m.active and m.hello.ticks_with_all for m in tickers if m.hello),
            on_orders=tuple(m for m in tickers if m.hello and m.hello.is_on_orders),
            at_intervals=tuple(
                (m, m.hello.interval) for m in tickers if m.hello and m.hello.interval
            ),
            sources=tuple(hello for hello in hellos if hello.draws and hello.when.every > 0),
            rates=_rates(hellos),
            every=max([1, *(hello.when.every for hello in hellos if hello.draws)]),
        )

    @property
    def resting(self) -> frozenset[str]:
        """The members among the tickers that have no events in a frame without orders."""
        entries = self.index.on_orders
        return frozenset(m.name for m in entries if m.active and m.rests) if entries else _NONE

    def active(self) -> tuple[MemberEntry, ...]:
        """The members that take part in frames."""
        return self.index.active

    def awaited(self) -> tuple[MemberEntry, ...]:
        """The members that the world waits for."""
        return self.index.awaited

    def takes_part(self, name: str) -> bool:
        """Whether a member of this name is expected or takes part in frames; from any thread."""
        member = self._entries.get(name)
        return member is not None and (member.expected or member.active)

    def named(self, member: MemberEntry) -> bool:
        """Whether a member is a process of the world file; any other is a guest."""
        return member.name in self._named

    def is_process(self, name: str) -> bool:
        """Whether this is the name of a process of the world file."""
        return name in self._named

    def is_guest(self, source: str) -> bool:
        """Whether a source of events is a person, or a member that is no process of the world."""
        return is_people(source) or not (source.startswith(("~", AGENTS)) or source in self._named)

    def missing_guests(self) -> list[str]:
        """Guests of the previous coordinator that have not returned yet, sorted."""
        return [m.name for m in self if m.expected and not self.named(m)]

    def declines_columns(self, name: str) -> bool:
        """Whether a member receives agents and events one by one instead of in columns."""
        # Not by `get`, which creates entries: addresses of groups, such as ~all, occur here, too.
        member = self._entries.get(name)
        return member is not None and member.hello is not None and member.hello.plain

    def offers(self) -> dict[str, frozenset[str]]:
        """The kinds offered by each active host; by a drained host, those that no other offers."""
        hosts = {m.name: _kinds(m.hello) for m in self.active() if m.hello is not None}
        kept = [kinds for name, kinds in hosts.items() if not self._entries[name].drained]
        # A drained host keeps the kinds that no other host offers,
        # or their agents would not evolve.
        elsewhere = frozenset[str]().union(*kept)
        offers = {
            name: kinds - elsewhere if self._entries[name].drained else kinds
            for name, kinds in hosts.items()
        }
        return {name: kinds for name, kinds in offers.items() if kinds}

    def machines(self) -> dict[str, str]:
        """The machine of each active member."""
        return {m.name: m.hello.host for m in self.active() if m.hello is not None}

    def awaited_kinds(self) -> frozenset[str]:
        """The kinds offered by hosts that are away and awaited."""
        hellos = [member.hello for member in self.awaited() if member.hello is not None]
        return frozenset[str]().union(*(_kinds(hello) for hello in hellos))

    def publishers_in_step(self) -> dict[str, tuple[str, ...]]:
        """The publishers in step of each sensor topic."""
        publishers: dict[str, tuple[str, ...]] = {}
        for member in self:
            hello = member.hello
            if hello is not None and hello.ticks and (member.active or member.awaited):
                for topic in hello.publishes:
                    publishers[topic] = (*publishers.get(topic, ()), member.name)
        return publishers

    def devices(self, event_type: str) -> list[tuple[MemberEntry, Hello]]:
        """The active devices that draw a visual event type."""
        hellos = [(member, member.hello) for member in self.active()]
        return [(member, h) for member, h in hellos if h is not None and event_type in h.draws]

    def standing_for_people(
        self, sources: Iterable[str], logged: FrameInputs | None = None
    ) -> tuple[str, ...]:
        """The generators among the sources of events that represent people, sorted.

        Their hello declares it, as a keyboard's does, or they were attached to the running world.
        They may have left since they sent the events, so the log decides for the sources of its
        events. A member that replaces a logged one is here, and its events are not in the log.
        """
        if logged is None:
            return tuple(sorted(filter(self._stands_for_people, sources)))
        here = set(sources).difference(logged.ticked, logged.taken)
        return tuple(sorted({*logged.people, *filter(self._stands_for_people, here)}))

    def _stands_for_people(self, source: str) -> bool:
        if source.startswith(("~", AGENTS)):
            return False
        # Only processes of the world file are trusted to be sensors or clocks.
        hello = self._entries[source].hello if source in self._named else None
        return source not in self._named or (hello is not None and hello.people)

    def makers(self, event_type: str) -> list[str]:
        """The generators, present or awaited, that make events of a type by themselves.

        Generators that represent people, or that take orders for the type, are not among them.
        """
        hellos = [m.hello for m in self if m.hello is not None and (m.active or m.expected)]
        return [
            hello.member
            for hello in hellos
            if event_type in hello.generates and event_type not in hello.orders and not hello.people
        ]

    def takers(self, event_type: str) -> list[str]:
        """The active generators that take people's orders for an event type."""
        hellos = [m.hello for m in self.active() if m.hello is not None]
        return [hello.member for hello in hellos if event_type in hello.orders]


def _rates(hellos: Iterable[Hello]) -> dict[str, float]:
    rates: dict[str, float] = {}
    for hello in hellos:
        for event_type in hello.draws if hello.when.rate > 0 else ():
            rates[event_type] = max(rates.get(event_type, 0.0), hello.when.rate)
    return rates


def _kinds(hello: Hello) -> frozenset[str]:
    return frozenset(kind.name for kind in hello.kinds)


_MAX_SHOWN = 500
"""Characters of the names of attributes in a reason: a hello may have thousands."""


def incompatibility(hello: Hello, vocabulary: Vocabulary) -> str:
    """Reason why a member cannot join a world of this vocabulary, or an empty string."""
    # The version is checked first, because in another version the
    # other fields may mean something else.
    if hello.version != PROTOCOL_VERSION:
        return (
            f"it speaks protocol {hello.version}, this world {PROTOCOL_VERSION}: install the same"
            " version of Minerva Bus on both sides"
        )
    for event_type in (*hello.generates, *hello.draws, *hello.orders):
        if event_type not in vocabulary.events:
            known = nearest(event_type, list(vocabulary.events))
            return f"the world's vocabulary has no event type {event_type}{known}"
    for event_type in hello.draws:
        if not vocabulary.events[event_type].visual:
            names = [name for name, each in vocabulary.events.items() if each.visual]
            visual = ", ".join(names) or "none"
            return f"it draws {event_type}, which is not visual; expected one of {visual}"
    # The coordinator generates such events itself and has no data for them.
    views = replace(hello.when, asked=Participation.NEVER)
    for event_type in hello.draws if hello.when.every or hello.when.rate else ():
        fields = vocabulary.events[event_type].fields.all
        required = [field.name for field in fields if field.default is None]
        if required:
            return (
                f"it cannot be the source of {event_type} itself, which needs {required[0]}; remove"
                f' "{views}" from its `when`, and use a generator for the event'
            )
    # Members in step count as publishers in step. A device that only draws answers its ticks
    # without readings, so the subscribers of its topics would wait for them forever.
    if hello.publishes and hello.coupled and not hello.when.is_awaited:
        return "it publishes readings but generates nothing: a publisher is a Generator too"
    reason = objection(
        hello.when,
        draws=bool(hello.draws) or hello.coupled,
        generates=bool(hello.generates),
        topics=bool(hello.topics),
        publishes=bool(hello.publishes),
        orders=bool(hello.orders),
    )
    if reason:
        return reason
    reasons = (_kind_mismatch(kind, vocabulary) for kind in hello.kinds)
    return next((reason for reason in reasons if reason), "")


def _kind_mismatch(kind: AgentKind, vocabulary: Vocabulary) -> str:
    expected = vocabulary.kinds.get(kind.name)
    if expected is None:
        return f"the world's vocabulary has no agents {kind.name}"
    mismatch = _state_mismatch(kind, expected)
    if mismatch:
        return f"{mismatch}: both must come from the same code"
    # Both affect the string. With other probabilities it would
    # depend on which host evolves an agent.
    if expected.chances != kind.chances:
        return f"its {kind.name} responds to events with other probabilities than in the world"
    if expected.rest != kind.rest:
        return f"its {kind.name} has other `rest` attributes than in the world"
    return ""


def _state_mismatch(kind: AgentKind, expected: AgentKind) -> str:
    """Difference between the attributes of a kind and the world's, or an empty string."""
    names, expected_names = kind.fields.names, expected.fields.names
    if names != expected_names:
        return (
            f"its {kind.name} has the state ({', '.join(names)[:_MAX_SHOWN]}),"
            f" the world's ({', '.join(expected_names)[:_MAX_SHOWN]})"
        )
    for own, other in zip(kind.fields.all, expected.fields.all, strict=True):
        if own.type != other.type:
            return (
                f"{own.name} of its {kind.name} is {_described(own.type, other.type)}, of the"
                f" world's {_described(other.type, own.type)}"
            )
    return ""


def _described(of: Type, other: Type) -> str:
    """A type as text; with all its parameters if the short texts of both are equal."""
    return str(of) if str(of) != str(other) else repr(of)


MAX_DEATHS: Final = 2
"""Ends of a host in one frame after which the frame is tried without the events of guests."""


class MemberLifecycle:
    """Handles members that appear, join, vanish, leave, are given up or misbehave."""

    def __init__(self, algorithm: FrameAlgorithm) -> None:
        self._algorithm = algorithm

    # --- joining ---

    def appeared(self, appeared: s.Appeared) -> None:
        """Greet a new process, which may replace one that has not vanished yet."""
        algorithm = self._algorithm
        member = algorithm.members.get(appeared.member)
        if member.active:
            self._note_death(member)
            self._lose(member)
            algorithm.advance()
        member.blamed = False
        algorithm.members.change(member, MemberChange.APPEARED)
        if algorithm.phase in (Phase.STOPPING, Phase.ENDED):
            algorithm.out.send(member.name, m.Stop(algorithm.shutdown.reason))
        else:
            algorithm.out.send(member.name, m.Greet())

    def hello(self, hello: m.Hello) -> None:
        """Check a hello, and admit its member now or when the next frame begins."""
        algorithm = self._algorithm
        member = algorithm.members.get(hello.member)
        # Greetings are repeated, so a second hello of the same process may arrive; it counts once.
        if member.state is not MemberState.JOINING or member.greeted:
            return
        reason = incompatibility(hello, algorithm.world.vocabulary)
        reason = reason or refusal_of_guest(algorithm, hello, hello.generates)
        reason = reason or self._refusal_of_second_host(hello)
        if reason:
            self._refuse(member, reason)
            return
        algorithm.members.introduce(member, hello)
        between = algorithm.phase in (Phase.WAITING, Phase.READY)
        # A host that joins while the generators answer can evolve agents in this frame already.
        in_time = algorithm.phase is Phase.TICK and hello.kinds
        awaited = algorithm.awaits_answer(member.name) or algorithm.in_flight.requests.unassigned
        if between or in_time or awaited:
            self._admit(member, hello)
        algorithm.start_if_complete()

    def _refusal_of_second_host(self, hello: m.Hello) -> str:
        """Why a host of agents may not join another one, or an empty string."""
        policy, members = self._algorithm.world.policy, self._algorithm.members
        if not (policy.rules.makes_copies and hello.kinds):
            return ""
        others = (*members.awaited(), *members.active(), *members.index.joining)
        hosts = {each.name: each for each in others if each.hello is not None and each.hello.kinds}
        hosts.pop(hello.member, None)
        only = f'policy = "{policy.value}" evolves all agents on one host, which is'
        if self._algorithm.phase is Phase.WAITING and members.is_process(hello.member):
            # A guest may be faster than the world's own host, without which the world would end.
            for guest in [host for host in hosts.values() if not members.named(host)]:
                del hosts[guest.name]
                reason = f"{only} {hello.member} of the world file"
                self._exclude(guest, f"may not take part: {reason}", reason)
        return f"{only} {min(hosts)}: give it all classes of agents" if hosts else ""

    def _refuse(self, member: MemberEntry, reason: str) -> None:
        algorithm = self._algorithm
        self._blame(member, f"may not join: {reason}")
        algorithm.out.send(member.name, m.Refused(reason))
        # Otherwise the world would wait forever: a process of the world file
        # that is incompatible now stays incompatible. A missing guest is given up after a while.
        named = algorithm.members.named(member)
        if member.expected and named and algorithm.phase is Phase.WAITING:
            algorithm.fail(f"{member.name} cannot take part: {reason}")

    def admit_joining(self) -> None:
        """Admit the members that have joined during the last frame."""
        for member in self._algorithm.members.index.joining:
            if member.hello is not None:
                self._admit(member, member.hello)

    def _admit(self, member: MemberEntry, hello: m.Hello) -> None:
        algorithm, world = self._algorithm, self._algorithm.world
        # First, because the following code reads the active members.
        algorithm.members.change(member, MemberChange.ADMITTED)
        # A guest of the previous coordinator is expected until it returns. From here on it is a
        # guest like any other, which nothing restarts and for which the world does not wait.
        if not algorithm.members.named(member):
            algorithm.members.stop_expecting(member)
        # A newcomer has not shown the string, so the world is not at
        # rest even if nothing has changed.
        member.last_reply = algorithm.views.last_change = algorithm.frame
        saved = algorithm.members.saved.get(member.name)
        # The welcome is first, because a member ignores all messages that need a world before it.
        algorithm.out.send(
            member.name,
            m.Welcome(
                world.name, world.vocabulary, world.seed, world.dt, algorithm.frame,
                world.policy.value, saved,
            ),
        )  # fmt: skip
        # Rules may place agents near this member, whose machine is known only now.
        near = member.name in world.placement.neighbours
        algorithm.placement.outdated |= near or bool(hello.kinds)
        self._send_publishers(member)
        self._send_missed(member, hello)
        in_flight = algorithm.in_flight
        if algorithm.phase is Phase.TICK and member.name in in_flight.pending:
            algorithm.source.ask(member)
        if in_flight.requests.unassigned and hello.kinds:
            algorithm.source.ask_again(sorted(in_flight.requests.unassigned))
        algorithm.source.members_changed(hello)

    def _send_missed(self, member: MemberEntry, hello: m.Hello) -> None:
        """Send a newcomer the latest views, and request a repetition of the latest readings."""
        algorithm = self._algorithm
        for event_type in hello.draws:
            keyframe = algorithm.views.keyframe(event_type)
            if keyframe is not None:
                algorithm.out.send(member.name, keyframe)
        for topic in hello.topics:
            for publisher in algorithm.members.publishers.get(topic, ()):
                algorithm.out.send(publisher, m.Repeat(topic))

    def _send_publishers(self, newcomer: MemberEntry) -> None:
        """Send the publishers of sensor topics to all members, or unchanged to a newcomer."""
        members, out = self._algorithm.members, self._algorithm.out
        publishers = members.publishers_in_step()
        if publishers != members.publishers:
            members.publishers = publishers
            out.send(s.EVERYONE, m.Sources(publishers))
        else:
            out.send(newcomer.name, m.Sources(publishers))

    # --- leaving ---

    def vanished(self, vanished: s.Vanished) -> None:
        """Continue without a member, or wait for its return."""
        algorithm = self._algorithm
        member = algorithm.members.get(vanished.member)
        if member.state in (MemberState.LOST, MemberState.LEFT):
            return
        if algorithm.phase is Phase.STOPPING:
            # Its report is still awaited: the disappearance of the token may overtake it.
            algorithm.shutdown.depart(member.name)
        elif algorithm.phase is not Phase.ENDED:
            # The change precedes the log line, so that the offers are without this host. `_lose`
            # follows it, because the line is about the placement from before.
            algorithm.members.change(member, MemberChange.VANISHED)
            algorithm.out.log(member.name, f"is gone{self._outlook_without(member)}")
            self._note_death(member)
        self._lose(member)

    def _note_death(self, member: MemberEntry) -> None:
        requests = self._algorithm.in_flight.requests
        if self._algorithm.phase is Phase.EVOLVE and requests.of(member.name):
            requests.deaths[member.name] = requests.deaths.get(member.name, 0) + 1

    def _outlook_without(self, member: MemberEntry) -> str:
        """Text for the log: the consequences for the world while a member is gone."""
        algorithm, placement, hello = self._algorithm, self._algorithm.placement, member.hello
        waits = "; the world waits for it" if member.needed else ""
        if algorithm.phase is Phase.WAITING or hello is None or hello.ticks:
            return waits
        if not hello.kinds:
            return "; the world continues" if member.needed else ""
        if not placement.fragments_of(member.name):
            return "; no agents lived on it"
        if placement.may_take_over(member.name, algorithm.offers()):
            return "; other hosts take its agents over"
        return waits or "; no other host can take its agents over"

    def leaving(self, leaving: m.Leaving) -> None:
        """Continue without a member that leaves voluntarily."""
        algorithm = self._algorithm
        member = algorithm.members.get(leaving.member)
        if member.state is not MemberState.LEFT:
            algorithm.members.change(member, MemberChange.WENT)
            algorithm.out.log(member.name, "has left")
            self._continue_without(member)
            algorithm.shutdown.report(member.name, {})  # It sends no report.
        algorithm.start_if_complete()

    def gave_up(self, gave_up: s.Abandoned) -> None:
        """Continue without a member that will not be restarted."""
        algorithm = self._algorithm
        member = algorithm.members.get(gave_up.member)
        algorithm.members.stop_expecting(member)
        over = algorithm.phase in (Phase.STOPPING, Phase.ENDED)
        if algorithm.members.change(member, MemberChange.GAVE_UP) and not over:
            algorithm.out.log(member.name, "is not restarted; the world continues without it")
            self._continue_without(member)
        algorithm.start_if_complete()

    def skip(self, skip: s.Skip) -> None:
        """Stop waiting for a member in this frame; a later reply is late."""
        algorithm = self._algorithm
        in_flight, requests = algorithm.in_flight, algorithm.in_flight.requests
        member = algorithm.members.get(skip.member)
        outstanding = requests.of(member.name)
        unassigned = bool(requests.unassigned) and member.awaited
        if not (algorithm.awaits_tick(member.name) or outstanding or unassigned):
            return
        algorithm.out.log(
            member.name, f"timed out in frame {algorithm.frame}; skipped for this frame"
        )
        if algorithm.phase is Phase.TICK:
            member.rests = False
            in_flight.pending.discard(member.name)
            return
        for key in outstanding:
            requests.left_out.update(requests.outstanding.pop(key))
        if unassigned:
            requests.left_out |= requests.unassigned
            requests.unassigned = set()
        # The host may still evolve its fragments, and its late reply is dropped. Their state there
        # is unknown, and it receives its fragments again.
        algorithm.placement.forget(member.name)
        algorithm.placement.outdated = True

    def violation(self, violation: s.Violation) -> None:
        """Exclude a member that violated the protocol."""
        algorithm = self._algorithm
        member = algorithm.members.get(violation.member)
        self._exclude(member, f"broke the protocol: {violation.reason}", violation.reason)

    def _exclude(self, member: MemberEntry, text: str, reason: str) -> None:
        self._blame(member, text)
        self._algorithm.out.send(member.name, m.Refused(reason))
        if member.active:
            self._lose(member)

    def _blame(self, member: MemberEntry, text: str) -> None:
        # An excluded member can misbehave any number of times, so only its first violation is
        # logged until a new process of this name appears.
        if member.active or not member.blamed:
            self._algorithm.out.log(member.name, text)
        member.blamed = True

    def _lose(self, member: MemberEntry) -> None:
        self._algorithm.members.change(member, MemberChange.VANISHED)
        if member.expected:
            self._reassign(member)
        else:
            self._algorithm.members.change(member, MemberChange.GAVE_UP)
            self._continue_without(member)

    def _continue_without(self, member: MemberEntry) -> None:
        algorithm = self._algorithm
        neighbour = member.name in algorithm.world.placement.neighbours
        algorithm.placement.outdated |= neighbour
        self._send_publishers(member)
        if algorithm.phase is Phase.TICK and member.name in algorithm.in_flight.pending:
            algorithm.in_flight.pending.discard(member.name)
        else:
            self._reassign(member)
        algorithm.source.members_changed(None)

    def _reassign(self, member: MemberEntry) -> None:
        """Reassign the fragments of a host that is gone, wait for it, or leave them out."""
        algorithm, in_flight = self._algorithm, self._algorithm.in_flight
        algorithm.placement.forget(member.name)
        algorithm.placement.outdated = True
        result, requests = in_flight.result, in_flight.requests
        # Its replies still count, but it no longer holds what it reported, so the
        # next host must receive the result.
        result.changed_by = {n: by for n, by in result.changed_by.items() if by != member.name}
        on_orders = member.hello is not None and member.hello.is_on_orders
        asked = member.name in in_flight.ticked or on_orders
        if algorithm.phase is Phase.TICK and member.awaited and asked:
            # Other members may still need the readings that it published in this frame. Its
            # successor continues from before the frame and publishes them again. Without a member
            # that takes orders, those that have arrived meanwhile would count as they are.
            in_flight.ticked.pop(member.name, None)
            in_flight.pending.add(member.name)
        if algorithm.phase not in (Phase.EVOLVE, Phase.CLOSING):
            return
        if requests.deaths.get(member.name, 0) >= MAX_DEATHS:
            requests.deaths[member.name] = 0
            if algorithm.source.lighten(member.name):
                return
        lost = [name for key in requests.of(member.name) for name in requests.outstanding.pop(key)]
        algorithm.source.ask_again(sorted({*lost, *requests.unassigned}))
