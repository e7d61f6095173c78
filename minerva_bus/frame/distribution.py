"""Which host has which fragments, and which of them a frame's events concern."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from minerva_bus.frame.composition import Composition, Fragment, fragment_in
from minerva_bus.frame.constraints import Offers
from minerva_bus.frame.load import Load
from minerva_bus.frame.messages import Fragments
from minerva_bus.frame.placement import place
from minerva_bus.frame.room import Room, agents_in, divided, fit
from minerva_bus.grammar.batch import AnyEvent
from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.scene import Scene, agents
from minerva_bus.grammar.vocabulary import Vocabulary

MANY = 16
"""Receivers of an event that are looked for together."""

WORTH = 64
"""So many agents at least are worth a host of their own."""


class Distribution:
    """Fragments over hosts; what a host has already is never sent to it again."""

    def __init__(self, vocabulary: Vocabulary, composition: Composition, most: int = 0) -> None:
        """`most` agents live on a host; 0: any number."""
        self._vocabulary = vocabulary
        self._most = most
        self._composition = composition
        self._offers: Offers = {}
        self._host: dict[str, str] = {}
        self._load = Load()
        self._held: dict[str, dict[str, Fragment | None]] = {}
        self._stale: dict[str, set[str]] = {}
        self._types: dict[str, frozenset[str]] = {}
        self._unwanted: dict[str, tuple[str, ...]] = {}
        self.unplaced: dict[str, frozenset[str]] = {}

    def arrange(self, offers: Offers, *, between: bool = True) -> None:
        """Place every fragment on one of the hosts that offer all of its kinds.

        `between` frames a population is cut anew where the hosts are not as many as its parts, and
        no host gets more agents than it takes. In the midst of one, whoever is left takes over.
        """
        self._offers = offers
        room = Room(offers, self._most if between else 0)
        if between:
            self._cut(offers)
        preferred = self._shares(offers)
        if not between:  # whoever evolves a part now goes on with it
            preferred |= {
                part: one for part, one in self._host.items() if one in offers and part in preferred
            }
        self._host = {}
        self._stale = {host: set() for host in offers}
        self.unplaced = {}
        kinds_on: dict[str, set[str]] = {host: set() for host in offers}
        for fragment, node in self._composition.fragments.items():
            kinds, count = kinds_of(node), agents_in(node) if self._most else 1
            with_room = room.of(_able(kinds, offers), count)
            host = preferred.get(fragment)
            if host not in with_room:
                host = place(fragment, with_room)
            if host is None:
                self.unplaced[fragment] = kinds
                continue
            self._host[fragment] = host
            room.take(host, count)
            kinds_on[host] |= kinds
            if self._held.get(host, {}).get(fragment) is not node:
                self._stale[host].add(fragment)
        self._types = {host: self._types_of(kinds) for host, kinds in kinds_on.items()}
        self._unwanted = {host: self._unwanted_on(host) for host in offers}

    def _cut(self, offers: Offers) -> None:
        """As many parts of each population as there are hosts for it, as big as suits them.

        What they have no room for is one part more.
        """
        room = Room(offers, self._most)
        for population in list(self._composition.populations):
            parts = [self._composition.parts[name] for name in population]
            rows = sum(part.count for part in parts)
            hosts = self._hosts_for(parts[0].symbol, rows, offers, room)
            rooms = [room.left(host) for host in hosts]
            sizes = divided(rows, self._load.weights(hosts, rows) if hosts else [1.0], rooms)
            for host, size in zip(hosts, sizes, strict=False):
                room.take(host, size)
            if (
                len(sizes) != len(parts)
                or self._lopsided(population)
                or not fit([part.count for part in parts], sizes, rooms)
            ):
                self._composition.cut(population, sizes)

    def _hosts_for(self, symbol: str, rows: int, offers: Offers, room: Room) -> list[str]:
        """The hosts that share a population: so many as are worth it, or as have room for it."""
        able = sorted(one for one, kinds in offers.items() if symbol in kinds)
        able = room.of(able, 1)
        chosen = able[: max(1, rows // WORTH)]
        while len(chosen) < len(able) and sum(map(room.left, chosen)) < rows:
            chosen.append(able[len(chosen)])
        return chosen

    def _lopsided(self, population: Sequence[str]) -> bool:
        """Whether some hosts have much more work with their parts than others."""
        parts = self._composition.parts
        on = {self._host[name]: parts[name].count for name in population if name in self._host}
        return len(on) == len(population) and self._load.lopsided(on)

    def took(self, host: str, seconds: float) -> None:
        """A host needed so long for the parts that it has."""
        parts = self._composition.parts
        rows = sum(part.count for name, part in parts.items() if self._host.get(name) == host)
        self._load.took(host, rows, seconds)

    @property
    def lopsided(self) -> bool:
        """Whether a population should be cut anew."""
        if self._most and (self.unplaced or self._overfull()):
            return True
        return any(map(self._lopsided, self._composition.populations))

    def _overfull(self) -> bool:
        return any(part.count > self._most for part in self._composition.parts.values())

    @property
    def homeless(self) -> int:
        """How many agents live on no host: they stand still."""
        return sum(agents_in(self._composition.fragments[one]) for one in self.unplaced)

    def _shares(self, offers: Offers) -> dict[str, str]:
        """The host of each part of a population: the first has the first, and so on."""
        found: dict[str, str] = {}
        room = Room(offers, self._most)
        for population in self._composition.populations:
            parts = [self._composition.parts[name] for name in population]
            rows = sum(part.count for part in parts)
            hosts = self._hosts_for(parts[0].symbol, rows, offers, room)
            for name, part, host in zip(population, parts, hosts, strict=False):
                found[name] = host
                room.take(host, part.count)
        return found

    def _unwanted_on(self, host: str) -> tuple[str, ...]:
        held = self._held.get(host, {})
        return tuple(sorted(fragment for fragment in held if self._host.get(fragment) != host))

    def _types_of(self, kinds: Iterable[str]) -> frozenset[str]:
        known = [self._vocabulary.kinds[kind] for kind in kinds]
        return frozenset[str]().union(*(kind.subscribes | kind.views for kind in known))

    def forget(self, host: str) -> None:
        """A host is gone, and all that it had."""
        self._held.pop(host, None)

    def may_take_over(self, host: str, offers: Offers) -> bool:
        """Whether hosts with these offers can have all that one has which is gone."""
        room, left = Room(offers, self._most), list[Fragment]()
        for fragment, node in self._composition.fragments.items():
            on = self._host.get(fragment)
            if on == host:
                left.append(node)
            elif on is not None and on in offers:
                room.take(on, agents_in(node))
        for node in left:
            kinds, count = kinds_of(node), agents_in(node)
            with_room = room.of(_able(kinds, offers), count)
            if not with_room:
                return False
            room.take(with_room[0], count)
        return True

    def fragments_of(self, host: str) -> list[str]:
        """The fragments placed on a host."""
        return [fragment for fragment, on in self._host.items() if on == host]

    def host_of(self, fragment: str) -> str | None:
        """The host of a fragment."""
        return self._host.get(fragment)

    @property
    def occupied(self) -> list[str]:
        """The hosts that have any fragments, sorted."""
        return sorted(set(self._host.values()))

    def concerned(self, events: Iterable[AnyEvent], visual: Iterable[AnyEvent]) -> list[str]:
        """The hosts that have an agent which one of the events may concern, sorted.

        A visual event with receivers concerns the others too: they show as ε (equation 4).
        """
        seen = {event.type for event in visual}
        found = {host for host, types in self._types.items() if types & seen}
        for event in events:
            if len(found) == len(self._types):
                break
            if event.receivers is not None and len(event.receivers):
                homes = self._homes(event.receivers)
                found.update(self._host[one] for one in homes if one in self._host)
            else:
                found.update(host for host, types in self._types.items() if event.type in types)
        return sorted(found)

    def _homes(self, receivers: Ids | tuple[str, ...]) -> Iterable[str]:
        if isinstance(receivers, Ids):
            return self._composition.homes(receivers)
        if len(receivers) > MANY:
            return self._composition.homes(Ids.of(receivers))
        homes = (self._composition.home(one) for one in receivers)
        return (one for one in homes if one is not None)

    def lacking(self, host: str) -> Fragments | None:
        """What a host must be given before it can evolve its fragments; None: nothing."""
        stale, dropped = self._stale[host], self._unwanted[host]
        if not stale and not dropped:
            return None
        fragments = self._composition.fragments
        held = self._held.setdefault(host, {})
        given = {one: fragments[one] for one in sorted(stale)}
        held.update(given)
        for one in dropped:
            del held[one]
        stale.clear()
        self._unwanted[host] = ()
        return Fragments({one: Scene((node,)) for one, node in given.items()}, dropped)

    def changed(self, host: str, fragment: str, result: Scene) -> None:
        """A host has made something else of a fragment; it keeps what is still that agent alone."""
        held = self._held.setdefault(host, {})
        placed = self._host.get(fragment, host)
        if placed != host:  # It moved while its old host still answered for it.
            self._stale[placed].add(fragment)
        if fragment not in held:  # And that has been told to let go of it.
            return
        piece = fragment_in(result, fragment)
        if piece is None:
            del held[fragment]
        else:
            held[fragment] = piece

    def overruled(self, fragment: str) -> None:
        """A fragment is not what its host has made of it: the host is given it anew."""
        host = self._host.get(fragment)
        if host is not None and fragment in self._composition.fragments:
            self._stale[host].add(fragment)
            self._held.setdefault(host, {})[fragment] = None


def _able(kinds: frozenset[str], offers: Offers) -> list[str]:
    """The hosts that offer all of these kinds."""
    return [one for one, offered in offers.items() if kinds <= offered]


def kinds_of(node: Fragment) -> frozenset[str]:
    """The kinds that a host must offer for a fragment."""
    if isinstance(node, Columns):
        return frozenset((node.symbol,))
    return frozenset(agent.symbol for agent in agents(Scene((node,))))
