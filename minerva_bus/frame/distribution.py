"""Which host has which fragments, and which of them a frame's events concern."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from minerva_bus.frame.composition import Composition
from minerva_bus.frame.messages import Fragments
from minerva_bus.frame.placement import place
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.scene import AgentNode, Scene, agents
from minerva_bus.grammar.vocabulary import Vocabulary

Offers = Mapping[str, frozenset[str]]


class Distribution:
    """Fragments over hosts; what a host has already is never sent to it again."""

    def __init__(self, vocabulary: Vocabulary, composition: Composition) -> None:
        self._vocabulary = vocabulary
        self._composition = composition
        self._offers: Offers = {}
        self._host: dict[str, str] = {}
        self._held: dict[str, dict[str, AgentNode]] = {}
        self._stale: dict[str, set[str]] = {}
        self._types: dict[str, frozenset[str]] = {}
        self._unwanted: dict[str, tuple[str, ...]] = {}
        self.unplaced: dict[str, frozenset[str]] = {}

    def arrange(self, offers: Offers) -> None:
        """Place every fragment on one of the hosts that offer all of its kinds."""
        self._offers = offers
        self._host = {}
        self._stale = {host: set() for host in offers}
        self.unplaced = {}
        kinds_on: dict[str, set[str]] = {host: set() for host in offers}
        for fragment, node in self._composition.fragments.items():
            kinds = _kinds(node)
            host = place(fragment, (one for one, offered in offers.items() if kinds <= offered))
            if host is None:
                self.unplaced[fragment] = kinds
                continue
            self._host[fragment] = host
            kinds_on[host] |= kinds
            if self._held.get(host, {}).get(fragment) is not node:
                self._stale[host].add(fragment)
        self._types = {host: self._types_of(kinds) for host, kinds in kinds_on.items()}
        self._unwanted = {host: self._unwanted_on(host) for host in offers}

    def _unwanted_on(self, host: str) -> tuple[str, ...]:
        held = self._held.get(host, {})
        return tuple(sorted(fragment for fragment in held if self._host.get(fragment) != host))

    def _types_of(self, kinds: Iterable[str]) -> frozenset[str]:
        known = [self._vocabulary.kinds[kind] for kind in kinds]
        return frozenset[str]().union(*(kind.subscribes | kind.views for kind in known))

    def forget(self, host: str) -> None:
        """A host is gone, and all that it had."""
        self._held.pop(host, None)

    def fragments_of(self, host: str) -> list[str]:
        """The fragments placed on a host."""
        return [fragment for fragment, on in self._host.items() if on == host]

    def host_of(self, fragment: str) -> str | None:
        """The host of a fragment."""
        return self._host.get(fragment)

    def concerned(self, events: Iterable[Event], visual: Iterable[Event]) -> list[str]:
        """The hosts that have an agent which one of the events may concern, sorted.

        A visual event with receivers concerns the others too: they show as ε (equation 4).
        """
        seen = {event.type for event in visual}
        found = {host for host, types in self._types.items() if types & seen}
        for event in events:
            if event.receivers:
                homes = (self._composition.home(one) for one in event.receivers)
                found.update(self._host[one] for one in homes if one in self._host)
            else:
                found.update(host for host, types in self._types.items() if event.type in types)
        return sorted(found)

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
        node = self._composition.fragments.get(fragment)
        placed = self._host.get(fragment, host)
        if placed != host:  # It moved while its old host still answered for it.
            self._stale[placed].add(fragment)
        if node is not None and is_agent(result, fragment):
            held[fragment] = node
        else:
            held.pop(fragment, None)


def is_agent(scene: Scene, agent: str) -> bool:
    """Whether a string is just the one agent of this id."""
    node = scene.nodes[0] if len(scene.nodes) == 1 else None
    return isinstance(node, AgentNode) and node.id == agent


def _kinds(node: AgentNode) -> frozenset[str]:
    return frozenset(agent.symbol for agent in agents(Scene((node,))))
