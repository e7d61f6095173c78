"""The members of a world: the table of their states, their roles, and queries over them.

            appeared             admitted             silent
(none), LOST ────────▶ JOINING ────────▶ PRESENT ◀────────▶ LATE
or LEFT                                           answered

From each of JOINING, PRESENT and LATE a member goes to LOST if it vanished, and to LEFT if it went;
from LOST to LEFT if it gave up, or went. Members of the world file begin in LOST.

A member that leaves of its own accord sends `Leaving`, and its token vanishes. Either may arrive
first, because Zenoh delivers token changes before data.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any, Final

from minerva_bus.errors import nearest
from minerva_bus.frame.messages import PROTOCOL_VERSION, Figures, Hello
from minerva_bus.frame.placement import Offers, PlacementRules
from minerva_bus.frame.stimuli import AGENTS, FrameInputs, is_people
from minerva_bus.grammar.types import Type
from minerva_bus.grammar.vocabulary import AgentKind, Vocabulary
from minerva_bus.world.services import Participation, objection


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


_LATE: Final = MemberState.LATE
_ACTIVE: Final = (MemberState.PRESENT, _LATE)


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
        return self.state in _ACTIVE

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

    `active` take part in frames, and the world waits for those `awaited`.
    `tickers` answer ticks; `sources` are the devices that generate their own visual events.
    Both include members that are away and awaited. `on_orders` receive a tick in frames with orders
    only, `at_intervals` in the frames that a number divides, `alone` are both; `joining` are to be
    admitted. `anyone_ticks`: the tick for all has a recipient. `rates` maps the visual event types
    of devices that request views by the clock to views per second. Any other device gets a view
    within `every` frames. `takers` are the generators that take people's orders, by event type.
    """

    active: tuple[MemberEntry, ...]
    awaited: tuple[MemberEntry, ...]
    joining: tuple[MemberEntry, ...]
    tickers: frozenset[str]
    anyone_ticks: bool
    on_orders: tuple[MemberEntry, ...]
    at_intervals: tuple[tuple[MemberEntry, int], ...]
    alone: tuple[MemberEntry, ...]
    sources: tuple[Hello, ...]
    rates: Mapping[str, float]
    every: int
    takers: Mapping[str, list[str]]

    def due_views(
        self, frame: int, clock: Iterable[str], *, closing: bool = False
    ) -> tuple[str, ...]:
        """The visual event types that devices generate in a frame, sorted; `closing`: all of them.

        `clock` are the event types of which a view is due by the clock.
        """
        due = {
            event_type
            for hello in self.sources
            if closing or frame % hello.when.every == 0
            for event_type in hello.draws
        }
        due.update(self.rates if closing else [name for name in clock if name in self.rates])
        return tuple(sorted(due))


class Members:
    """Members by name in `entries`, and queries over them; iteration is sorted by name."""

    def __init__(self, expected: Iterable[str], divided: Iterable[str] = ()) -> None:
        """`expected`: the processes of the world file; `divided`: generators that some divide."""
        self.entries = {
            name: MemberEntry(name, expected=True, state=MemberState.LOST)
            for name in sorted(expected)
        }
        # The processes of the world file, kept apart because
        # `expected` changes while the world runs.
        self._named = frozenset((*self.entries, *divided))
        self._departed: dict[str, None] = {}
        self._index: MemberIndex | None = None
        self.publishers: dict[str, tuple[str, ...]] = {}
        """The publishers in step of each sensor topic, as last announced to all members."""
        self.saved: dict[str, Mapping[str, Any]] = {}
        """Data saved by members in their last complete frame; ~names are the coordinator's."""
        self.strangers: int = 0
        """Number of messages from senders that never appeared."""

    def __iter__(self) -> Iterator[MemberEntry]:
        return iter([self.entries[name] for name in sorted(self.entries)])

    @property
    def count(self) -> int:
        """Number of members that have appeared or are expected, without those that have left."""
        return len(self.entries) - len(self._departed)

    def knows(self, name: str) -> bool:
        """Whether a member of this name is expected or has ever appeared."""
        return name in self.entries

    def get(self, name: str) -> MemberEntry:
        """The member of a name; creates its entry if necessary."""
        member = self.entries.get(name)
        if member is None:
            member = self.entries[name] = MemberEntry(name)
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

    def answered(self, member: MemberEntry, frame: int) -> None:
        """Note that a member has answered in a frame, so that it is no longer late."""
        member.last_reply = frame
        if member.state is _LATE:
            self.change(member, MemberChange.ANSWERED)

    def _note_departed(self, member: MemberEntry) -> None:
        # Guests can use any number of names, so the table keeps only the latest of those that left.
        self._departed.pop(member.name, None)
        if member.state is MemberState.LEFT and not member.expected:
            self._departed[member.name] = None
        if len(self._departed) > MAX_DEPARTED:
            first = next(iter(self._departed))
            del self._departed[first]
            self.entries.pop(first, None)
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
        on_orders = tuple(m for m in tickers if m.hello and m.hello.is_on_orders)
        at_intervals = tuple((m, m.hello.interval) for m in tickers if m.hello and m.hello.interval)
        return MemberIndex(
            active=tuple(m for m in members if m.active),
            awaited=tuple(m for m in members if m.awaited),
            joining=tuple(m for m in members if m.state is MemberState.JOINING and m.greeted),
            tickers=frozenset(m.name for m in tickers),
            anyone_ticks=any(m.active and m.hello.ticks_with_all for m in tickers if m.hello),
            on_orders=on_orders,
            at_intervals=at_intervals,
            alone=(*on_orders, *[m for m, _ in at_intervals]),
            sources=tuple(hello for hello in hellos if hello.draws and hello.when.every > 0),
            rates=_rates(hellos),
            every=max([1, *(hello.when.every for hello in hellos if hello.draws)]),
            takers=_takers(m.hello for m in members if m.active and m.hello is not None),
        )

    @property
    def resting(self) -> frozenset[str]:
        """The members among the tickers that have no events in a frame without orders."""
        entries = self.index.on_orders
        return frozenset(m.name for m in entries if m.active and m.rests) if entries else _NONE

    def takes_part(self, name: str) -> bool:
        """Whether a member of this name is expected or takes part in frames; from any thread."""
        member = self.entries.get(name)
        return member is not None and (member.expected or member.active)

    def is_process(self, name: str) -> bool:
        """Whether this is the name of a process of the world file; any other member is a guest."""
        return name in self._named

    def is_guest(self, source: str) -> bool:
        """Whether a source of events is a person, or a member that is no process of the world."""
        return is_people(source) or not (source.startswith(("~", AGENTS)) or source in self._named)

    def missing_guests(self) -> list[str]:
        """Guests of the previous coordinator that have not returned yet, sorted."""
        return [m.name for m in self if m.expected and m.name not in self._named]

    def declines_columns(self, name: str) -> bool:
        """Whether a member receives agents and events one by one instead of in columns."""
        # Not by `get`, which creates entries: addresses of groups, such as ~all, occur here, too.
        member = self.entries.get(name)
        return member is not None and member.hello is not None and member.hello.plain

    def offers(self) -> dict[str, frozenset[str]]:
        """The kinds offered by each active host; by a drained host, those that no other offers."""
        hosts = {m.name: _kinds(m.hello) for m in self.index.active if m.hello is not None}
        kept = [kinds for name, kinds in hosts.items() if not self.entries[name].drained]
        # A drained host keeps the kinds that no other host offers,
        # or their agents would not evolve.
        elsewhere = frozenset[str]().union(*kept)
        offers = {
            name: kinds - elsewhere if self.entries[name].drained else kinds
            for name, kinds in hosts.items()
        }
        return {name: kinds for name, kinds in offers.items() if kinds}

    def allowed_offers(self, rules: PlacementRules) -> Offers:
        """The kinds that each host may evolve, as far as these rules allow."""
        return rules.allowed(self.offers(), self.machines())

    def machines(self) -> dict[str, str]:
        """The machine of each active member."""
        return {m.name: m.hello.host for m in self.index.active if m.hello is not None}

    def awaited_kinds(self) -> frozenset[str]:
        """The kinds offered by hosts that are away and awaited."""
        hellos = [member.hello for member in self.index.awaited if member.hello is not None]
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
        hellos = [(member, member.hello) for member in self.index.active]
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
        hello = self.entries[source].hello if source in self.entries else None
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
        return self.index.takers.get(event_type, [])


def _takers(hellos: Iterable[Hello]) -> dict[str, list[str]]:
    takers: dict[str, list[str]] = {}
    for hello in hellos:
        for event_type in dict.fromkeys(hello.orders):
            takers.setdefault(event_type, []).append(hello.member)
    return takers


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
    visual = ", ".join(name for name, each in vocabulary.events.items() if each.visual) or "none"
    for event_type in (*hello.generates, *hello.draws, *hello.orders):
        if event_type not in vocabulary.events:
            drawn = f"its visual ones: {visual}" if event_type in hello.draws else ""
            known = nearest(event_type, list(vocabulary.events), drawn)
            return f"the world's vocabulary has no event type {event_type}{known}"
    for event_type in hello.draws:
        if not vocabulary.events[event_type].visual:
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
    reason = ""
    # All of these affect the string, which would depend on the host that evolves an agent.
    for what, own, other in (
        ("has the state", kind.fields.names, expected.fields.names),
        ("responds to", sorted(kind.subscribes), sorted(expected.subscribes)),
        ("has views for", sorted(kind.views), sorted(expected.views)),
        ("has the probabilities", kind.chances, expected.chances),
        ("has the `rest` attributes", kind.rest, expected.rest),
    ):
        if own != other and not reason:
            reason = f"its {kind.name} {what} ({_listed(own)}), the world's ({_listed(other)})"
    for own, other in zip(kind.fields.all, expected.fields.all, strict=False):
        if own.type != other.type and not reason:
            types = _described(own.type, other.type), _described(other.type, own.type)
            reason = f"{own.name} of its {kind.name} is {types[0]}, of the world's {types[1]}"
    return reason and f"{reason}: both must come from the same code"


def _listed(names: Iterable[object]) -> str:
    return ", ".join(map(str, names))[:_MAX_SHOWN] or "nothing"


def _described(of: Type, other: Type) -> str:
    """A type as text; with all its parameters if the short texts of both are equal."""
    return str(of) if str(of) != str(other) else repr(of)
