"""Composition of a world's string: a static skeleton, and the fragments in its slots.

Fragments are outermost agents and parts of populations.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import accumulate, pairwise
from typing import Any, Final, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import VocabularyError
from minerva_bus.frame.messages import Changes, Parts
from minerva_bus.grammar.columns import (
    CHUNK,
    Columns,
    Delta,
    check_delta,
    one_by_one,
    packed,
    patched,
)
from minerva_bus.grammar.ids import LONGEST, Ids, repeated_id, same_id
from minerva_bus.grammar.scene import EMPTY, AgentNode, Piece, Scene, agents, fill, fill_slots
from minerva_bus.grammar.types import Unfit

PART: Final = "~"
"""Prefix of the names of parts of populations; no agent's id begins with it."""

Fragment: TypeAlias = AgentNode | Columns
Layout: TypeAlias = tuple[tuple[tuple[str, int], ...], ...]
"""The parts of each population: name and number of rows."""


def fragment_in(scene: Scene, name: str) -> Fragment | None:
    """The fragment of this name, if the string consists of it alone; otherwise None."""
    piece = scene.pieces[0] if len(scene.pieces) == 1 else None
    if piece is not None and piece.ids is not None:
        return piece if name.startswith(PART) else None
    return piece if isinstance(piece, AgentNode) and piece.id == name else None


def ids_of(part: Columns) -> Ids:
    """The ids of a part of a population."""
    return cast("Ids", part.ids)


def shares(rows: int, weights: Sequence[float]) -> list[int]:
    """Number of rows for each host, by weight; at least one while there are enough.

    Large populations are divided at chunk boundaries.
    """
    # The digest of the population can reuse the chunk digests of its parts if these are whole
    # chunks. With few chunks per host, rounding to them would make the shares too unequal.
    unit = CHUNK if rows >= 4 * CHUNK * len(weights) else 1
    ends = np.cumsum(weights) / sum(weights) * (rows / unit)
    cuts = [0]
    for place, end in enumerate(ends[:-1], 1):
        most = rows - len(weights) + place  # Each later host needs one as well.
        cuts.append(max(min(round(end) * unit, most), min(cuts[-1] + 1, rows)))
    return [end - begin for begin, end in pairwise([*cuts, rows])]


FIRST: Final = 64


class Composition:
    """w as a skeleton with a slot for each *fragment*, and the fragments by name.

    A fragment is the unit of evolution and transfer: an outermost agent with all of its scope,
    under its id; or a part of a population, agents in columns, under a name that begins with ~.
    Without `columns` each agent is a fragment of its own, regardless of the representation: under
    the literal policy a frame turns one row into several, which must not depend on the parts.
    """

    def __init__(self, scene: Scene, *, columns: bool = True) -> None:
        self._named: int = 0
        self._held = packed if columns else one_by_one
        self._take_apart(self._held(scene), {})

    def _take_apart(self, scene: Scene, named: Mapping[str, Scene]) -> None:
        """Take a string apart; parts that are among the fragments `named` keep their names."""
        kept = {name: fragment_in(scene, name) for name, scene in named.items()}
        # By identity, because a comparison of columns would read all their rows.
        self._names = {id(part): name for name, part in kept.items() if part is not None}
        self._scene: Scene | None = scene
        # In the order of the string, on which `places` relies.
        self.fragments: dict[str, Fragment] = {}
        self._home: dict[str, str] = {}
        self._kind: dict[str, str] = {}
        self._single: Mapping[str, int] | None = None
        self.parts: dict[str, Columns] = {}
        self.populations: list[list[str]] = []
        self.skeleton = self._skeleton(scene)
        self._check_apart()

    def _skeleton(self, scene: Scene) -> Scene:
        made: list[Piece] = []
        before = ""
        for piece in scene.pieces:
            # Adjacent columns of one kind are parts of one population;
            # anything between them separates two.
            if piece.ids is not None:
                made += self._part_slot(piece, beside=piece.symbol == before)
                before = piece.symbol
                continue
            before = ""
            if piece.still:
                made.append(piece)
            else:
                made += fill_slots(Scene((piece,)), self._slot).pieces
        return Scene(tuple(made)) if made else EMPTY

    def _slot(self, node: AgentNode) -> Scene:
        self.fragments[node.id] = node
        for inner in agents(Scene((node,))):
            if inner.id in self._home:
                raise VocabularyError(same_id(inner.id))
            self._home[inner.id] = node.id
            self._kind[inner.id] = inner.symbol
        return Scene((AgentNode(node.symbol, node.id),))

    def _part_slot(self, part: Columns, *, beside: bool) -> Sequence[Piece]:
        name = self._names.get(id(part), "")
        # Names are not reused, because hosts and devices hold former parts by their names.
        if not name:
            self._named += 1
            name = f"{PART}{part.symbol}.{self._named}"
        self.fragments[name] = self.parts[name] = part
        if beside:
            self.populations[-1].append(name)
        else:
            self.populations.append([name])
        return (AgentNode(part.symbol, name),)

    def _check_apart(self) -> None:
        """Raise VocabularyError if an id occurs in two columns, or in columns and elsewhere."""
        repeated = repeated_id([ids_of(part) for part in self.parts.values()], self._home.keys())
        if repeated is not None:
            raise VocabularyError(same_id(repeated))

    @property
    def scene(self) -> Scene:
        """The whole string w."""
        # Computed on demand: most frames change some fragments,
        # and nothing reads the whole string.
        if self._scene is None:
            self._scene = fill(self.skeleton, self._as_strings())
        return self._scene

    @property
    def empty(self) -> bool:
        """Whether w is ε."""
        return not self.skeleton.pieces

    def home(self, agent: str) -> str | None:
        """The fragment that contains an agent, or None."""
        home = self._home.get(agent)
        if home is None and self.parts:
            parts = self.parts.items()
            return next((name for name, part in parts if ids_of(part).row_of(agent) >= 0), None)
        return home

    def home_of_each(self, agents: Iterable[str]) -> dict[str, str]:
        """The fragments of these agents, by agent; agents that are not in the string are omitted.

        Faster for many agents than `home`, which would search all parts for each of them.
        """
        homes: dict[str, str] = {}
        others: list[str] = []
        for agent in agents:
            home = self._home.get(agent)
            if home is not None:
                homes[agent] = home
            elif len(agent) <= LONGEST:  # A longer id does not fit into a column.
                others.append(agent)
        if not (others and self.parts):
            return homes
        ids = Ids.of(others)
        for name, part in self.parts.items():
            homes |= {others[row]: name for row in np.flatnonzero(ids_of(part).rows_of(ids) >= 0)}
        return homes

    def elsewhere(self, agents: Ids, fragment: str, owners: Mapping[str, str]) -> str | None:
        """The first of these agents that another fragment has; `owners` are fragments of others."""
        parts = [ids_of(part) for name, part in self.parts.items() if name != fragment]
        twice = first_in(agents, parts)
        if twice is None and (self._home or owners):
            for agent in agents:
                if not fragment == self._home.get(agent, fragment) == owners.get(agent, fragment):
                    return agent
        return twice

    def first_missing(self, agents: Ids | None) -> str | None:
        """The first of these agents that is not in the string; None if all are."""
        parts = self.parts.values()
        # An event for all agents of a part shares its ids.
        if agents is None or any(part.ids is agents for part in parts):
            return None
        left = agents
        for part in parts:
            left = left.take(ids_of(part).rows_of(left) < 0)
        return next((agent for agent in left.texts() if agent not in self._home), None)

    def homes(self, agents: Ids) -> Iterator[str]:
        """The fragments that contain these agents."""
        exact = next((name for name, part in self.parts.items() if part.ids is agents), None)
        if exact is not None:
            yield exact
            return
        if not self._home:
            # Of many agents, the first few are usually in all parts.
            first = agents.take(slice(FIRST))
            if all((ids_of(part).rows_of(first) >= 0).any() for part in self.parts.values()):
                yield from self.parts
                return
        left = agents
        for name, part in self.parts.items():
            there = ids_of(part).rows_of(left) >= 0
            if there.any():
                yield name
                if there.all():
                    return
                left = left.take(~there)
        if self._home:
            for agent in sorted(set(left.texts()) & self._home.keys()):
                yield self._home[agent]

    def places(self, names: Iterable[str]) -> Callable[[str], tuple[int, int]]:
        """Sort key of agents, or of fragments in columns: their position in the string."""
        order = {name: place for place, name in enumerate(self.fragments)}
        homes = {name: name if name in order else self.home(name) or name for name in names}
        within = {
            agent.id: place
            for home in sorted(set(homes.values()))
            if (node := self.fragments.get(home)) is not None and isinstance(node, AgentNode)
            for place, agent in enumerate(agents(Scene((node,))))
        }
        for name, home in homes.items():
            if home in self.parts and name != home:
                within[name] = ids_of(self.parts[home]).row_of(name)
        return lambda name: (order.get(homes[name], -1), within.get(name, 0))

    def kind(self, agent: str) -> str:
        """Symbol of an agent's kind, or an empty string if there is no such agent."""
        kind = self._kind.get(agent)
        if kind is None:
            home = self.home(agent)
            return self.fragments[home].symbol if home is not None else ""
        return kind

    def kinds(self, agents: Ids) -> NDArray[Any]:
        """Symbols of the kinds of n agents, shape (n,); empty strings for unknown agents."""
        kinds = np.full(len(agents), "", object)
        if self._kind:
            kinds[:] = [self._kind.get(agent, "") for agent in agents]
        for part in self.parts.values():
            kinds[ids_of(part).rows_of(agents) >= 0] = part.symbol
        return kinds

    def agents(self) -> Iterable[str]:
        """The ids of all agents, also those within others."""
        yield from self._home
        for part in self.parts.values():
            yield from ids_of(part)

    @property
    def count(self) -> int:
        """Number of agents."""
        return len(self._home) + sum(part.count for part in self.parts.values())

    @property
    def single(self) -> Mapping[str, int]:
        """Number of agents outside columns, by kind."""
        if self._single is None:
            self._single = Counter(self._kind.values())
        return self._single

    def agent(self, agent: str) -> AgentNode | None:
        """The outermost agent that has this id or contains the agent that has it, or None."""
        home = self.home(agent)
        if home is None:
            return None
        fragment = self.fragments[home]
        if fragment.ids is None:
            return cast("AgentNode", fragment)
        return cast("AgentNode", fragment.node(fragment.ids.row_of(agent)))

    def replace(self, changes: Mapping[str, Scene]) -> bool:
        """Replace fragments by the results of λ; True if the skeleton has changed.

        Agents have different ids after it: replies are checked when they arrive.
        """
        if not changes:
            return False
        # A new skeleton turns all views into keyframes, so fragments are
        # replaced in place if possible.
        in_place = all(map(self._same_shape, changes, changes.values()))
        if not in_place:
            parts = {**self._as_strings(), **changes}
            self._take_apart(self._held(fill(self.skeleton, parts)), parts)
            return True
        for name, scene in changes.items():
            piece: Any = scene.pieces[0]
            self.fragments[name] = piece
            if piece.ids is not None:
                self.parts[name] = piece
        self._scene = None
        return False

    def _same_shape(self, name: str, scene: Scene) -> bool:
        if len(scene.pieces) != 1:
            return False
        piece, old = scene.pieces[0], self.fragments[name]
        if piece.symbol != old.symbol or type(piece) is not type(old):
            return False
        if not isinstance(piece, AgentNode) or not isinstance(old, AgentNode):
            return True
        # Another scope may contain other agents, which `_home` and `_kind` have to list.
        same_scope = piece.scope is old.scope or not (piece.scope.pieces or old.scope.pieces)
        return piece.id == name and same_scope

    def become(self, scene: Scene) -> None:
        """Replace the whole string; remaining parts of populations keep their names.

        Raises VocabularyError if two agents share an id.
        """
        self._take_apart(self._held(scene), self._as_strings())

    def divide(self, population: Sequence[str], sizes: Sequence[int]) -> None:
        """Divide a population into parts of these sizes; they get new names."""
        parts = self._as_strings()
        # All rows take the place of the first part, so their
        # order in the string does not change.
        divided = _in_place_of(population, self._pieces(population, sizes))
        self._take_apart(fill(self.skeleton, {**parts, **divided}), parts)

    def _pieces(self, population: Sequence[str], sizes: Sequence[int]) -> list[Columns]:
        rows = Columns.concatenated([self.parts[name] for name in population])
        ends = accumulate(sizes)
        return [rows.take(slice(end - size, end)) for size, end in zip(sizes, ends, strict=True)]

    @property
    def layout(self) -> Layout:
        """The parts of each population: names and rows."""
        if not self.populations:
            return ()
        return tuple(
            [
                tuple([(name, self.parts[name].count) for name in population])
                for population in self.populations
            ]
        )

    def lay_out(self, layout: Layout) -> None:
        """Divide all populations into parts of these names and rows. Raises Unfit."""
        if layout == self.layout:
            return
        # Names and cuts may differ, but the populations must be the same.
        if [_rows(parts) for parts in layout] != [_rows(parts) for parts in self.layout]:
            raise Unfit("parts of other populations")
        whole, named = dict[str, Scene](), dict[str, Scene]()
        for population, parts in zip(self.populations, layout, strict=True):
            pieces = self._pieces(population, [count for _, count in parts])
            names = [name for name, _ in parts]
            named |= {name: Scene((piece,)) for name, piece in zip(names, pieces, strict=True)}
            whole |= _in_place_of(population, pieces)
        strings = self._as_strings().items()
        agents = {name: own for name, own in strings if name not in self.parts}
        # Later names must not repeat those of the log.
        self._named = max(self._named, *(int(name.rpartition(".")[2]) for name in named))
        self._take_apart(fill(self.skeleton, {**agents, **whole}), {**agents, **named})

    def _as_strings(self) -> dict[str, Scene]:
        return {name: Scene((node,)) for name, node in self.fragments.items()}


def _in_place_of(population: Sequence[str], pieces: Sequence[Piece]) -> dict[str, Scene]:
    """Contents of the slots of a population's parts after a division into these pieces."""
    return {**dict.fromkeys(population, EMPTY), population[0]: Scene(tuple(pieces))}


def _rows(parts: Iterable[tuple[str, int]]) -> int:
    return sum(count for _, count in parts)


def first_in(agents: Ids, others: Iterable[Ids]) -> str | None:
    """The first of these agents that is among others; None if none is."""
    for ids in others if len(agents) else ():
        rows = np.flatnonzero(ids.rows_of(agents) >= 0)
        if len(rows):
            return agents[int(rows[0])]
    return None


def applied(parts: Parts, changes: Changes) -> dict[str, Scene]:
    """What changes make of the fragments or views of their names. Raises Unfit."""
    return {
        name: Scene((patched(_piece(parts, name), change),))
        if isinstance(change, Delta)
        else change
        for name, change in changes.items()
    }


def check_deltas(parts: Parts, changes: Changes) -> None:
    """Raise Unfit if deltas do not fit the fragments or views of their names."""
    for name, change in changes.items():
        if isinstance(change, Delta):
            check_delta(_piece(parts, name), change)


def _piece(parts: Parts, name: str) -> Piece:
    old = parts.get(name, EMPTY)
    if len(old.pieces) != 1:
        raise Unfit(f"a patch of {name}, which is not in columns")
    return old.pieces[0]
