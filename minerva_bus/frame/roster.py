"""Everybody the coordinator has heard of, and the questions it asks about them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from minerva_bus.errors import nearest
from minerva_bus.frame.membership import Change, Member, State
from minerva_bus.frame.messages import Hello
from minerva_bus.grammar.symbols import AgentKind
from minerva_bus.grammar.types import Type
from minerva_bus.grammar.vocabulary import Vocabulary

PROTOCOL_VERSION = 6
MOST_DEPARTED = 200
"""Guests who are still listed when they have left; who left longest ago is forgotten."""


@dataclass(frozen=True, slots=True)
class Attending:
    """What every frame asks of the roster, worked out once for as long as nobody moves.

    `tickers` are those asked in a tick and `sources` the devices that are the source of their own
    visual events, both also while they are away for a moment; `ahead` are those asked before the
    frame begins; `joining` those to be admitted. `rates` has the visual event types of devices
    that want views by the clock, and how many a second; of the others, all see one within `every`
    frames.
    """

    here: tuple[Member, ...]
    awaited: tuple[Member, ...]
    joining: tuple[Member, ...]
    tickers: frozenset[str]
    anyone_ticks: bool
    ahead: tuple[str, ...]
    sources: tuple[Hello, ...]
    rates: Mapping[str, float]
    every: int


class Roster:
    """Members by name; iteration is sorted by name."""

    def __init__(self, expected: Iterable[str]) -> None:
        self._members = {
            name: Member(name, expected=True, state=State.LOST) for name in sorted(expected)
        }
        self._named = frozenset(self._members)
        self._departed: dict[str, None] = {}
        self._attending: Attending | None = None

    def __iter__(self) -> Iterator[Member]:
        return iter([self._members[name] for name in sorted(self._members)])

    @property
    def count(self) -> int:
        """How many have come, or are expected."""
        return len(self._members) - len(self._departed)

    def knows(self, name: str) -> bool:
        """Whether this one is expected or has ever appeared."""
        return name in self._members

    def declines_columns(self, name: str) -> bool:
        """Whether a member wants all that it gets node by node."""
        member = self._members.get(name)
        return member is not None and member.hello is not None and member.hello.plain

    def get(self, name: str) -> Member:
        """The member of a name, known or not so far."""
        member = self._members.get(name)
        if member is None:
            member = self._members[name] = Member(name)
            self._attending = None
            self._note_departed(member)
        return member

    def change(self, member: Member, change: Change) -> bool:
        """Move a member by the table of states; False where the table has no such move."""
        self._attending = None
        if change is Change.APPEARED:
            member.greeted = False
        moved = member.change(change)
        self._note_departed(member)
        return moved

    def _note_departed(self, member: Member) -> None:
        """Keep in mind who has left, the last ones: names that come and go have no end."""
        self._departed.pop(member.name, None)
        if member.state is State.LEFT and not member.expected:
            self._departed[member.name] = None
        if len(self._departed) > MOST_DEPARTED:
            longest_gone = next(iter(self._departed))
            del self._departed[longest_gone]
            self._members.pop(longest_gone, None)

    def expected(self) -> frozenset[str]:
        """Whom the world waits for where they are away."""
        return frozenset(name for name, member in self._members.items() if member.expected)

    def expect(self, name: str) -> None:
        """Somebody of this name will come (back), and is waited for."""
        member = self.get(name)
        if not member.expected:
            member.expected, member.state = True, State.LOST
            self._attending = None
            self._note_departed(member)

    def expect_no_more(self, member: Member) -> None:
        """Nobody waits for this one any longer."""
        self._attending = None
        member.expected = False
        self._note_departed(member)

    def introduce(self, member: Member, hello: Hello) -> None:
        """A member has said who it is."""
        self._attending = None
        member.hello, member.greeted, member.drained = hello, True, False
        member.joins += 1

    @property
    def attending(self) -> Attending:
        """Who takes part now, by what is asked of them."""
        if self._attending is None:
            self._attending = self._look()
        return self._attending

    def _look(self) -> Attending:
        members = list(self)
        here = tuple(member for member in members if member.here)
        tickers = [m for m in members if m.ticks and (m.here or m.awaited)]
        hellos = [m.hello for m in members if m.hello is not None and (m.here or m.awaited)]
        return Attending(
            here=here,
            awaited=tuple(member for member in members if member.awaited),
            joining=tuple(m for m in members if m.state is State.JOINING and m.greeted),
            tickers=frozenset(member.name for member in tickers),
            anyone_ticks=any(member.here and not _ahead(member) for member in tickers),
            ahead=tuple(member.name for member in tickers if member.here and _ahead(member)),
            sources=tuple(hello for hello in hellos if hello.every > 0),
            rates=_rates(hellos),
            every=max([1, *(hello.every for hello in hellos)]),
        )

    def here(self) -> tuple[Member, ...]:
        """Those who take part in frames."""
        return self.attending.here

    def awaited(self) -> tuple[Member, ...]:
        """Those whom the world waits for."""
        return self.attending.awaited

    def offers(self) -> dict[str, frozenset[str]]:
        """The hosts that are here and the kinds that each offers.

        One that is drained offers only what nobody else does.
        """
        hosts = {m.name: _kinds(m.hello) for m in self.here() if m.hello is not None}
        kept = [kinds for name, kinds in hosts.items() if not self._members[name].drained]
        others = frozenset[str]().union(*kept)
        offers = {
            name: kinds - others if self._members[name].drained else kinds
            for name, kinds in hosts.items()
        }
        return {name: kinds for name, kinds in offers.items() if kinds}

    def machines(self) -> dict[str, str]:
        """The machine that each member who is here runs on."""
        return {m.name: m.hello.host for m in self.here() if m.hello is not None}

    def awaited_kinds(self) -> frozenset[str]:
        """The kinds that hosts offer which are away for a moment."""
        hellos = [member.hello for member in self.awaited() if member.hello is not None]
        return frozenset[str]().union(*(_kinds(hello) for hello in hellos))

    def sources(self) -> dict[str, tuple[str, ...]]:
        """The lockstep publishers of each sensor topic."""
        found: dict[str, tuple[str, ...]] = {}
        for member in self:
            hello = member.hello
            if hello is not None and hello.ticks and (member.here or member.awaited):
                for topic in hello.publishes:
                    found[topic] = (*found.get(topic, ()), member.name)
        return found

    def devices(self, event_type: str) -> list[tuple[Member, Hello]]:
        """The devices that draw a visual event type."""
        found = [(member, member.hello) for member in self.here()]
        return [(member, h) for member, h in found if h is not None and event_type in h.draws]

    def stand_for_people(self) -> frozenset[str]:
        """The generators whose events count as sent by people.

        They say so themselves, as a keyboard does, or somebody has attached them to the world.
        """
        named, here = self._named, self.here()
        return frozenset(
            m.name for m in here if m.name not in named or (m.hello is not None and m.hello.people)
        )

    def makers(self, event_type: str) -> list[str]:
        """The generators, other than people's hands, that make events of a type by themselves.

        Those that take orders for the type are left out, those that are away for a moment are not.
        """
        hellos = [m.hello for m in self if m.hello is not None and (m.here or m.expected)]
        return [
            hello.member
            for hello in hellos
            if event_type in hello.generates and event_type not in hello.orders and not hello.people
        ]

    def takers(self, event_type: str) -> list[Member]:
        """The generators that take people's orders for an event type."""
        here = self.here()
        return [m for m in here if m.hello is not None and event_type in m.hello.orders]


def _rates(hellos: Iterable[Hello]) -> dict[str, float]:
    found: dict[str, float] = {}
    for hello in hellos:
        for event_type in hello.draws if hello.rate > 0 else ():
            found[event_type] = max(found.get(event_type, 0.0), hello.rate)
    return found


def _ahead(member: Member) -> bool:
    return member.hello is not None and member.hello.ahead


def _kinds(hello: Hello) -> frozenset[str]:
    return frozenset(kind.name for kind in hello.kinds)


def objection(hello: Hello, vocabulary: Vocabulary) -> str:
    """Why a member cannot join a world of this vocabulary, or the empty text."""
    if hello.version != PROTOCOL_VERSION:
        return (
            f"it speaks protocol {hello.version}, this world {PROTOCOL_VERSION}: install the same"
            " version of Minerva Bus on both sides"
        )
    for event_type in (*hello.generates, *hello.draws, *hello.orders):
        if event_type not in vocabulary.events:
            known = nearest(event_type, list(vocabulary.events))
            return f"the world's vocabulary has no event type {event_type}{known}"
    for event_type in hello.draws if hello.every or hello.rate else ():
        wanting = [
            one.name for one in vocabulary.events[event_type].fields.all if one.default is None
        ]
        if wanting:
            return (
                f"it cannot be the source of {event_type} itself, which needs {wanting[0]}; let a"
                " generator make the event (every = 0, rate = 0)"
            )
    if hello.publishes and hello.coupled and not hello.lockstep:
        return "it publishes readings but generates nothing: a publisher is a Generator too"
    found = (_objection_to(kind, vocabulary) for kind in hello.kinds)
    return next((reason for reason in found if reason), "")


def _objection_to(kind: AgentKind, vocabulary: Vocabulary) -> str:
    mine = vocabulary.kinds.get(kind.name)
    if mine is None:
        return f"the world's vocabulary has no agents {kind.name}"
    difference = _differing(kind, mine)
    if difference:
        return f"{difference}: both must come from the same code"
    if mine.chances != kind.chances:
        return f"its {kind.name} answers events with other probabilities than the world's"
    if mine.rest != kind.rest:
        return f"its {kind.name} rests by other attributes than the world's"
    return ""


def _differing(its: AgentKind, worlds: AgentKind) -> str:
    """In what the state of two kinds of one name differs, or the empty text."""
    names, others = its.fields.names, worlds.fields.names
    if names != others:
        return (
            f"its {its.name} has the state ({', '.join(names)}), the world's ({', '.join(others)})"
        )
    for own, other in zip(its.fields.all, worlds.fields.all, strict=True):
        if own.type != other.type:
            return (
                f"{own.name} of its {its.name} is {_described(own.type, other.type)}, of the"
                f" world's {_described(other.type, own.type)}"
            )
    return ""


def _described(of: Type, other: Type) -> str:
    """A type in words; where these are the same for another one, with all that it is."""
    return str(of) if str(of) != str(other) else repr(of)
