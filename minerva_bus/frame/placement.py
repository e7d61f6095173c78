"""Placement: assignment of fragments to hosts, and the hosts that a frame's events concern.

`PlacementRules` are those of a world file; `Capacity` and `Load` give the shares of hosts, by their
limits and their speed.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import field
from fnmatch import fnmatchcase
from functools import lru_cache
from hashlib import blake2b
from typing import Final, TypeAlias

import numpy as np

from minerva_bus.frame.composition import Composition, Fragment, fragment_in, shares
from minerva_bus.frame.messages import Fragments
from minerva_bus.frame.stimuli import Instructions
from minerva_bus.grammar.events import AnyEvent
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.scene import Scene, kind_counts
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.values import fast_dataclass
from minerva_bus.wording import counted

Offers: TypeAlias = Mapping[str, frozenset[str]]
"""The kinds of agents that each host offers to evolve, by host."""


@fast_dataclass
class Rule:
    """Restricts the hosts that may evolve agents of one kind.

    `only`: hosts whose names match one of these patterns (`*` and `?`); empty: any host.
    `near`: hosts on the same machine as the member of this name.
    """

    only: tuple[str, ...] = ()
    near: str = ""

    def allows(self, host: str, machines: Mapping[str, str]) -> bool:
        """Whether a host may evolve such agents; `machines` maps members to machines."""
        # `fnmatch` ignores case on some platforms, but names of members are case-sensitive.
        matches = not self.only or any(fnmatchcase(host, pattern) for pattern in self.only)
        # Without the member there is no machine to be near to. The empty text cannot stand for a
        # missing machine, because a host's machine may be the empty text.
        near = self.near in machines and machines[self.near] == machines.get(host)
        return matches and (near or not self.near)


@fast_dataclass
class PlacementRules:
    """Rules by kind, and the maximum number of agents per host; 0: any number."""

    rules: Mapping[str, Rule] = field(default_factory=dict[str, Rule])
    agents_per_host: int = 0

    @property
    def neighbours(self) -> frozenset[str]:
        """The members to whose machines the rules refer."""
        return frozenset(rule.near for rule in self.rules.values() if rule.near)

    def allowed(self, offers: Offers, machines: Mapping[str, str]) -> dict[str, frozenset[str]]:
        """The offers of hosts that the rules allow; a host may be left with no kinds."""
        if not self.rules:
            return dict(offers)
        any_host = Rule()
        return {
            host: frozenset(k for k in kinds if self.rules.get(k, any_host).allows(host, machines))
            for host, kinds in offers.items()
        }


class Capacity:
    """Remaining capacity of hosts that take up to `limit` agents each; 0: no limit."""

    def __init__(self, hosts: Iterable[str], limit: int) -> None:
        self._left = dict.fromkeys(hosts, float(limit) if limit else math.inf)

    def left(self, host: str) -> float:
        """Remaining capacity of a host in agents."""
        return self._left[host]

    def with_room(self, hosts: Iterable[str], count: int) -> list[str]:
        """The hosts with capacity for `count` further agents."""
        return [host for host in hosts if self._left[host] >= count]

    def take(self, host: str, count: int) -> None:
        """Assign `count` agents to a host."""
        self._left[host] -= count


def agents_in(fragment: Fragment) -> int:
    """Number of agents in a fragment, including agents in the scope of others."""
    return kind_counts(fragment).total()


def apportion(rows: int, weights: Sequence[float], capacities: Sequence[float]) -> list[int]:
    """Number of rows for each host, by weight and within its capacity.

    Rows that exceed the capacity of all hosts are one more number at the end.
    """
    sizes = shares(rows, weights)
    excess = 0
    for place, capacity in enumerate(capacities):
        # Only a finite capacity can be exceeded, so `int` cannot fail.
        if sizes[place] > capacity:
            excess += sizes[place] - int(capacity)
            sizes[place] = int(capacity)
    # In the order of the hosts, so that every run gives the excess to the same ones.
    for place, capacity in enumerate(capacities):
        more = min(excess, capacity - sizes[place])
        sizes[place] += int(more)
        excess -= int(more)
    return [*sizes, excess] if excess else sizes


def fit(counts: Sequence[int], sizes: Sequence[int], capacities: Sequence[float]) -> bool:
    """Whether parts of these row counts may stay, although `sizes` would be apportioned now.

    Each part must fit its host; a surplus part must contain the rows that exceed all capacities.
    """
    inside = all(count <= limit for count, limit in zip(counts, capacities, strict=False))
    return inside and (len(counts) <= len(capacities) or list(counts) == list(sizes))


WINDOW: Final = 16
"""Frames over which the speed of a host is measured."""

_MIN_ROWS: Final = 8192
"""Rows per host below which the cost of moving rows exceeds the gain."""

_MAX_RATIO: Final = 1.3
"""Ratio of the slowest host's time to the balanced time that is worth moving rows."""

HOST_SECONDS: Final = 1.5e-3
"""Time that another host adds to a frame: CPU time of the coordinator, 1.4 to 1.7 ms measured."""


def hosts_for(work: float) -> int:
    """The number n of hosts with the shortest frame, of `work / n + (n - 1) * HOST_SECONDS`.

    It is the greatest for which the last host saves what it costs: n (n - 1) HOST_SECONDS <= work.
    """
    return int(0.5 + math.sqrt(0.25 + work / HOST_SECONDS))


class Load:
    """Speed of hosts in rows per second: the median over the last `WINDOW` frames."""

    def __init__(self) -> None:
        self._speeds: dict[str, list[float]] = {}

    def note(self, host: str, rows: int, elapsed: float) -> None:
        """Note the seconds that a host needed for some rows."""
        if rows and elapsed > 0:
            speeds = self._speeds.setdefault(host, [])
            speeds.append(rows / elapsed)
            del speeds[:-WINDOW]

    def weights(self, hosts: Sequence[str], rows: int) -> list[float]:
        """Shares of some rows by the speed of these hosts.

        The shares are equal while the speed of a host is unknown, and for few rows: the
        time of a frame does then not depend on rows, so a host with fewer would seem slower.
        """
        known = [self._speed(host) for host in hosts]
        return known if rows >= _MIN_ROWS * len(hosts) and all(known) else [1.0] * len(hosts)

    def imbalanced(self, rows: Mapping[str, int]) -> bool:
        """Whether other shares would be much faster than this number of rows per host."""
        speeds = [self._speed(host) for host in rows]
        # With few rows the time does not depend on their number. A host with fewer rows would then
        # seem slower, receive fewer still, and end with none.
        total = sum(rows.values())
        if len(rows) < 2 or not all(speeds) or total < _MIN_ROWS * len(rows):
            return False
        slowest = max(count / speed for count, speed in zip(rows.values(), speeds, strict=True))
        return slowest > _MAX_RATIO * total / sum(speeds)

    def seconds(self, rows: int, hosts: Iterable[str]) -> float:
        """Time of some rows in the fastest of the last frames of these hosts; 0 while unknown."""
        # The fastest, so that neither a busy machine nor the first frame, which imports, counts.
        known = [max(self._speeds[host]) for host in hosts if len(self._speeds.get(host, ())) > 1]
        return rows / max(known) if known else 0.0

    def _speed(self, host: str) -> float:
        speeds = self._speeds.get(host, [])
        # The median, so that a single slow frame does not move rows.
        return float(np.median(speeds)) if len(speeds) == WINDOW else 0.0


class UnassignedLog:
    """State of the log about agents without a host."""

    def __init__(self, limit: int) -> None:
        """`limit`: maximum number of agents of one host; 0: any number."""
        self._limit = limit
        self._count = 0
        self._offered: set[frozenset[str]] = set()
        self._reported: set[frozenset[str]] = set()

    def count(self, agents: int, *, rules: bool, out: Instructions) -> None:
        """Log the number of agents without a host, if it has changed and rules or limits apply."""
        if agents == self._count or not (rules or self._limit):
            return
        self._count = agents
        if not agents:
            out.log("placement", "every agent has a host again")
            return
        verbs = "has no host and does" if agents == 1 else "have no host and do"
        limit = f"a host takes {self._limit} (agents_per_host)"
        reason = limit if self._limit else "see [placement]"
        out.log(
            "placement",
            f"{counted(agents, 'agent')} {verbs} not evolve: {reason}; attach another host",
        )

    def kinds(
        self,
        offers: Iterable[frozenset[str]],
        unassigned: Collection[frozenset[str]],
        out: Instructions,
    ) -> None:
        """Log, once, the kinds that no host has ever offered: the world may lack a process.

        If a host that offered them is gone, its loss has been logged.
        """
        # Also of hosts that are gone: their loss has been logged already.
        self._offered.update(offers)
        missing = {kinds for kinds in unassigned if not any(map(kinds.issubset, self._offered))}
        for kinds in sorted(map(sorted, missing - self._reported)):
            names = f"all of {', '.join(kinds)}" if len(kinds) > 1 else kinds[0]
            still = "these agents do not evolve; add their class to agents, or attach a host"
            out.log("placement", f"no host offers {names}: {still}")
        self._reported |= missing


MIN_BATCH: Final = 16
"""Receivers of an event above which they are looked up together."""

MIN_AGENTS: Final = 64
"""Agents that justify a further host for a population, whatever time they take."""


class Placement:
    """Assignment of fragments to hosts; a host never receives what it already holds.

    `unassigned`: fragments without a host, and their kinds. They keep their state.
    `outdated`: hosts or the string have changed, so fragments must be arranged before the next
    request.
    """

    def __init__(self, vocabulary: Vocabulary, composition: Composition, limit: int = 0) -> None:
        """`limit`: the number of agents that one host takes; 0: any number."""
        self._vocabulary = vocabulary
        self._limit = limit
        self._composition = composition
        self._offers: Offers = {}
        self._host: dict[str, str] = {}
        self._fragments: dict[str, tuple[str, ...]] = {}
        self._load = Load()
        self._held: dict[str, dict[str, Fragment | None]] = {}
        self._stale: dict[str, set[str]] = {}
        self._types: dict[str, frozenset[str]] = {}
        self._unwanted: dict[str, tuple[str, ...]] = {}
        self.unassigned: dict[str, frozenset[str]] = {}
        self.outdated = True
        self.log = UnassignedLog(limit)

    def arrange(self, offers: Offers, *, mid_frame: bool = False) -> None:
        """Assign each fragment to a host that offers all of its kinds.

        Between frames populations are divided again if the number of hosts has changed, and no
        host gets more agents than its limit. `mid_frame` the remaining hosts take over
        regardless of the limit, because the frame waits for the fragments.
        """
        self._offers = offers
        capacity = Capacity(offers, 0 if mid_frame else self._limit)
        preferred = self._shares(divide=not mid_frame)
        if mid_frame:  # A host that is evolving a part must keep it.
            parts = self._composition.parts.keys() & self._host.keys()
            preferred |= {part: self._host[part] for part in parts if self._host[part] in offers}
        self._host, self.unassigned = {}, {}
        # Computed from scratch: the missing fragments follow from those that the host holds.
        self._stale = {host: set() for host in offers}
        kinds_on: dict[str, set[str]] = {host: set() for host in offers}
        fragments: dict[str, list[str]] = {host: [] for host in offers}
        for fragment, node in self._composition.fragments.items():
            kinds, count = kinds_of(node), agents_in(node) if self._limit else 1
            hosts = capacity.with_room(_able(kinds, offers), count)
            host = preferred.get(fragment)
            if host not in hosts:
                host = place(fragment, hosts)
            if host is None:
                self.unassigned[fragment] = kinds
                continue
            self._host[fragment] = host
            capacity.take(host, count)
            kinds_on[host] |= kinds
            fragments[host].append(fragment)
            # Identity suffices: the composition keeps the very object
            # that the host's reply contained.
            if self._held.get(host, {}).get(fragment) is not node:
                self._stale[host].add(fragment)
        # Computed here, so that a frame finds the fragments of a host, and the hosts of an event
        # type, without looking at all fragments.
        self._fragments = {host: tuple(names) for host, names in fragments.items()}
        self._types = {host: self._types_of(kinds) for host, kinds in kinds_on.items()}
        self._unwanted = {host: self._unwanted_on(host) for host in offers}

    def _shares(self, *, divide: bool) -> dict[str, str]:
        """The host of each part of a population, in order.

        To `divide` gives each population one part per host, sized by the hosts' speed. Rows that
        exceed the capacity of the hosts form one more part.
        """
        shares: dict[str, str] = {}
        composition, capacity = self._composition, Capacity(self._offers, self._limit)
        for number in range(len(composition.populations)):
            population = composition.populations[number]
            counts = [composition.parts[name].count for name in population]
            hosts = self._hosts_for(population, capacity)
            if divide:
                limits = [capacity.left(host) for host in hosts]
                weights = self._load.weights(hosts, sum(counts)) if hosts else [1.0]
                sizes = apportion(sum(counts), weights, limits)
                # Moving rows costs more than a slight imbalance, so parts
                # that may stay are left as they are.
                if (
                    len(sizes) != len(counts)
                    or self._imbalanced(population)
                    or not fit(counts, sizes, limits)
                ):
                    composition.divide(population, sizes)
                    population = composition.populations[number]
            for name, host in zip(population, hosts, strict=False):
                shares[name] = host
                capacity.take(host, composition.parts[name].count)
        return shares

    def _hosts_for(self, population: Sequence[str], capacity: Capacity) -> list[str]:
        """The hosts that share a population: as many as its size or time justifies or requires."""
        parts = [self._composition.parts[name] for name in population]
        rows = sum(part.count for part in parts)
        # By name, as the protocol defines it: the division must not depend on the order of joining.
        able = sorted(host for host, kinds in self._offers.items() if parts[0].symbol in kinds)
        able = capacity.with_room(able, 1)
        on = {self._host[name] for name in population if name in self._host}
        # Further hosts must be worth moving agents; those that it has need only pay.
        work = self._load.seconds(rows, on)
        worthwhile, paid = hosts_for(work / _MAX_RATIO), hosts_for(work)
        chosen = able[: max(rows // MIN_AGENTS, worthwhile, min(len(on), paid))]
        # With a limit, a population may need more hosts than its size justifies.
        while len(chosen) < len(able) and sum(map(capacity.left, chosen)) < rows:
            chosen.append(able[len(chosen)])
        return chosen

    def _imbalanced(self, population: Sequence[str]) -> bool:
        """Whether some hosts need much more time for their parts than others."""
        parts = self._composition.parts
        on = {self._host[name]: parts[name].count for name in population if name in self._host}
        return len(on) == len(population) and self._load.imbalanced(on)

    def note_elapsed(self, host: str, seconds: float) -> None:
        """Note the seconds that a host needed for its parts of populations."""
        parts = self._composition.parts
        rows = sum(part.count for name, part in parts.items() if self._host.get(name) == host)
        self._load.note(host, rows, seconds)

    @property
    def imbalanced(self) -> bool:
        """Whether a population should be divided again."""
        parts = self._composition.parts.values()
        if self._limit and (self.unassigned or any(part.count > self._limit for part in parts)):
            return True
        divisions, capacity = self._composition.populations, Capacity(self._offers, self._limit)
        others = (len(each) != len(self._hosts_for(each, capacity)) for each in divisions)
        return any(others) or any(map(self._imbalanced, divisions))

    @property
    def unassigned_agents(self) -> int:
        """Number of agents without a host; they keep their state."""
        return sum(agents_in(self._composition.fragments[name]) for name in self.unassigned)

    def _unwanted_on(self, host: str) -> tuple[str, ...]:
        held = self._held.get(host, {})
        return tuple(sorted(fragment for fragment in held if self._host.get(fragment) != host))

    def _types_of(self, kinds: Iterable[str]) -> frozenset[str]:
        known = [self._vocabulary.kinds[kind] for kind in kinds]
        return frozenset[str]().union(*(kind.subscribes | kind.views for kind in known))

    def forget(self, host: str) -> None:
        """Forget the fragments that a host holds, because its process is gone."""
        self._held.pop(host, None)

    def may_take_over(self, host: str, offers: Offers) -> bool:
        """Whether hosts with these offers can take over all fragments of a host that is gone."""
        capacity, left = Capacity(offers, self._limit), list[Fragment]()
        for fragment, node in self._composition.fragments.items():
            on = self._host.get(fragment)
            if on == host:
                left.append(node)
            elif on is not None and on in offers:
                capacity.take(on, agents_in(node))
        for node in left:
            kinds, count = kinds_of(node), agents_in(node)
            hosts = capacity.with_room(_able(kinds, offers), count)
            if not hosts:
                return False
            # An approximation for the log: the arrangement itself prefers certain hosts.
            capacity.take(hosts[0], count)
        return True

    def fragments_of(self, host: str) -> tuple[str, ...]:
        """The fragments assigned to a host."""
        return self._fragments.get(host, ())

    def host_of(self, fragment: str) -> str | None:
        """The host of a fragment, or None."""
        return self._host.get(fragment)

    @property
    def occupied(self) -> list[str]:
        """The hosts with at least one fragment, sorted."""
        return sorted(set(self._host.values()))

    def concerned(self, events: Sequence[AnyEvent], visual: Sequence[AnyEvent]) -> list[str]:
        """The hosts with an agent that one of the events may concern, sorted.

        A visual event with receivers concerns other agents too: their view is ε (equation 4).
        """
        shown = {event.type for event in visual}
        hosts = {host for host, types in self._types.items() if types & shown}
        for event in events:
            # All hosts get a request anyway, so the remaining events need no check.
            if len(hosts) == len(self._types):
                break
            if event.receivers is not None and len(event.receivers):
                homes = self._homes(event.receivers)
                hosts.update(self._host[home] for home in homes if home in self._host)
            else:
                hosts.update(host for host, types in self._types.items() if event.type in types)
        return sorted(hosts)

    def _homes(self, receivers: Ids | tuple[str, ...]) -> Iterable[str | None]:
        if isinstance(receivers, Ids):
            return self._composition.homes(receivers)
        if len(receivers) > MIN_BATCH:
            return self._composition.homes(Ids.of(receivers))
        return map(self._composition.home, receivers)

    def lacking(self, host: str) -> Fragments | None:
        """Fragments that a host must receive or drop before it can evolve; None without any."""
        stale, dropped = self._stale[host], self._unwanted[host]
        if not stale and not dropped:
            return None
        fragments = self._composition.fragments
        held = self._held.setdefault(host, {})
        given = {name: fragments[name] for name in sorted(stale)}
        # Noted when sent: delivery is reliable while the process runs, and
        # `forget` clears this when it is gone.
        held.update(given)
        for name in dropped:
            del held[name]
        stale.clear()
        self._unwanted[host] = ()
        return Fragments({name: Scene((node,)) for name, node in given.items()}, dropped)

    def changed(self, host: str, fragment: str, result: Scene) -> None:
        """Note a host's result; the host keeps it if it is still a single agent."""
        held = self._held.setdefault(host, {})
        placed = self._host.get(fragment, host)
        if placed != host:  # It moved after the request to its former host.
            self._stale[placed].add(fragment)
        if fragment not in held:  # The host was requested to drop it.
            return
        piece = fragment_in(result, fragment)
        if piece is None:
            del held[fragment]
        else:
            held[fragment] = piece

    def resend(self, fragment: str) -> None:
        """Send a fragment to its host again, because a norm has rejected a host's result."""
        # None means an unknown state: no fragment is identical with it, and the host still receives
        # a request to drop the fragment when it moves. A former host may have evolved it, too, if
        # it has moved since the frame began.
        for held in self._held.values():
            if fragment in held:
                held[fragment] = None
        host = self._host.get(fragment)
        if host is not None and fragment in self._composition.fragments:
            self._stale[host].add(fragment)
            self._held.setdefault(host, {})[fragment] = None


def place(agent: str, hosts: Iterable[str]) -> str | None:
    """The host of an agent by rendezvous hashing, or None if there are no hosts.

    When hosts join or leave, only the agents of these hosts move.
    """
    return max(hosts, key=lambda host: (_weight(host, agent), host), default=None)


placed = lru_cache(65_536)(place)
"""As `place`, for hosts in a tuple: each frame asks for the same agents."""


def _weight(host: str, agent: str) -> bytes:
    # Not `hash`, which differs between processes: the protocol defines the placement.
    return blake2b(f"{host}\0{agent}".encode(), digest_size=8).digest()


def _able(kinds: frozenset[str], offers: Offers) -> list[str]:
    """The hosts that offer all of these kinds."""
    return [host for host, offered in offers.items() if kinds <= offered]


def kinds_of(node: Fragment) -> frozenset[str]:
    """The kinds that a host must offer for a fragment."""
    return frozenset(kind_counts(node))
