"""Places: sort keys of the nodes of a string, which regions can assign without each other.

The place of a node of the initial string is its number. When λ replaces the node at place p in
frame t by several, the first one takes p, and the i-th after it p + (-t, i):

    (4,)  ->  (4,) · (4, -7, 1) · (4, -7, 2)        #a gives birth to two agents in frame 7
          ->  (4,) · (4, -9, 1) · (4, -7, 1) · ...  and to another one in frame 9

Later results sort before earlier ones, as in the string, where they directly follow the node that
is replaced. Places of different nodes are never equal, because a node is replaced only once in a
frame. So the nodes of all regions, sorted by place, are the string of a single coordinator.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import chain, pairwise
from typing import Final

import numpy as np

from minerva_bus.errors import ProtocolError, WorldStopped
from minerva_bus.frame.composition import Composition
from minerva_bus.grammar.batch import AnyEvent, Events
from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.scene import AgentNode, Piece, Scene, agents
from minerva_bus.regions.place_table import Place, PlaceTable, joined, taken
from minerva_bus.world.lineage import parents_of

_COUNT: Final = np.dtype("<u4")
_NUMBER: Final = np.dtype("<i8")


def heirs(place: Place, count: int, frame: int) -> list[Place]:
    """The places of `count` nodes that replace the node at a place in a frame."""
    return [place, *((*place, -frame, number) for number in range(1, count))][:count]


def after_frame(
    places: Sequence[Place], composition: Composition, changed: Mapping[str, Scene], frame: int
) -> Sequence[Place]:
    """The places of the nodes of the next string.

    Args:
        places: those of the nodes of the present string, in its order.
        composition: the present string, before the results replace its fragments.
        changed: the result of each changed fragment.
        frame: number of the frame.

    Raises:
        WorldStopped: agents in columns leave nodes beside themselves.

    """
    made: list[Sequence[Place]] = []
    same = True
    for _, name, begin, end in spans(composition):
        own, result = places[begin:end], changed.get(name)
        made.append(own if result is None else _of_result(own, composition, name, result, frame))
        same = same and made[-1] is own
    return places if same else joined(made)


def _of_result(
    own: Sequence[Place], composition: Composition, name: str, result: Scene, frame: int
) -> Sequence[Place]:
    """The places of the nodes that replace a fragment; its `own` ones if these are theirs."""
    old = composition.fragments[name]
    if old.ids is not None:
        return _of_rows(own, old, result, frame)
    count = _size(result)
    return own if count == len(own) == 1 else heirs(own[0], count, frame)


class SenderPlaces:
    """Finds the places of the senders of events, in the string before their frame's changes."""

    def __init__(self, places: Sequence[Place], composition: Composition) -> None:
        self._places = places
        self._composition = composition
        self._begins: dict[str, int] = {}
        for piece, name, begin, _ in spans(composition):
            # The slots in a transformation are agents without scopes.
            inside = () if name or piece.still else agents(Scene((piece,)))
            names = [name] if name else [slot.id for slot in inside]
            self._begins.update(dict.fromkeys(names, begin))

    def of(self, event: AnyEvent) -> Sequence[Place]:
        """The place of the sender, or of each sender of a batch."""
        senders = event.senders if isinstance(event, Events) else Ids.of([event.sender])
        assert senders is not None  # Agents always send in their own name.
        nodes = np.full(len(senders), -1, np.intp)
        for name, part in self._composition.parts.items():
            rows = _ids(part).rows_of(senders)
            nodes = np.where(rows >= 0, rows + self._begins[name], nodes)
        for row in np.flatnonzero(nodes < 0).tolist():
            nodes[row] = self._begins[self._composition.home(senders[row]) or ""]
        return taken(self._places, nodes)


def spans(composition: Composition) -> Iterator[tuple[Piece, str, int, int]]:
    """The pieces of the skeleton, each with its fragment and its range of nodes.

    The fragment is "" for other pieces, such as a transformation around fragments, which is always
    one node.
    """
    end = 0
    for piece in composition.skeleton.pieces:
        name = piece.id if isinstance(piece, AgentNode) else ""
        begin, end = end, end + (composition.fragments[name] if name else piece).count
        yield piece, name, begin, end


def _size(scene: Scene) -> int:
    return sum(piece.count for piece in scene.pieces)


def _of_rows(places: Sequence[Place], old: Columns, new: Scene, frame: int) -> Sequence[Place]:
    """The places of the nodes by which λ has replaced agents in columns."""
    ids, piece = _ids(old), new.pieces[0] if len(new.pieces) == 1 else None
    # Without births and deaths, which most frames have not, the ids are the same object.
    if piece is not None and piece.ids is ids:
        return places
    made: list[Place] = []
    before, number = -1, 0
    for row in _authors(old, new):
        number = number + 1 if row == before else 0
        made.append(places[row] if not number else (*places[row], -frame, number))
        before = row
    return made


def _authors(old: Columns, new: Scene) -> list[int]:
    """The row of the agent by whose λ each node exists: itself, its parent, or what left it."""
    names = [name for piece in new.pieces for name in _names_in(piece)]
    rows = _ids(old).rows_of(Ids.of(names)) if names else np.empty(0, np.intp)
    authors: list[int | None] = [row if row >= 0 else None for row in rows.tolist()]
    unknown = [name for name, row in zip(names, authors, strict=True) if name and row is None]
    parents: Mapping[str, int] = _parents_in(old, unknown) if unknown else {}
    authors = [
        row if row is not None else parents.get(name)
        for name, row in zip(names, authors, strict=True)
    ]
    return _between(authors, old)


def _names_in(piece: Piece) -> Sequence[str]:
    """The id of the first agent in each node; "" for a node without agents."""
    if piece.ids is not None:
        return piece.ids.texts()
    if isinstance(piece, Columns):
        return [""] * piece.count
    first = next(agents(Scene((piece,))), None)
    return ["" if first is None else first.id]


def _parents_in(old: Columns, newborns: Sequence[str]) -> Mapping[str, int]:
    """The rows of the parents of newborns."""
    if "births" not in old.names:
        return {}
    ids = _ids(old).texts()
    births = dict(zip(ids, old.column("births").tolist(), strict=True))
    rows = {name: row for row, name in enumerate(ids)}
    return {child: rows[parent] for child, parent in parents_of(newborns, births).items()}


def _between(authors: Sequence[int | None], old: Columns) -> list[int]:
    """The authors with the missing ones filled in, where both neighbours have the same."""
    made: list[int] = []
    following = _following(authors, old.count - 1)
    before = 0
    for author, after in zip(authors, following, strict=True):
        if author is None:
            author = before
            if before != after:
                raise WorldStopped(
                    f"regions: agents of the kind {old.symbol}, held in columns, have returned"
                    " nodes that belong to no row of them; return agents by `self.child(...)`,"
                    " or run this world without regions"
                )
        made.append(author)
        before = author
    return made


def _following(authors: Sequence[int | None], last: int) -> list[int]:
    """The next known author at or after each node."""
    made: list[int] = []
    for author in reversed(authors):
        last = last if author is None else author
        made.append(last)
    return made[::-1]


def _ids(part: Columns) -> Ids:
    assert part.ids is not None
    return part.ids


def packed_places(places: Sequence[Place]) -> bytes:
    """The length of each place as uint32, then all numbers as int64, little-endian."""
    if not places:
        return b""
    if isinstance(places, PlaceTable):
        count, length = places.table.shape
        return np.full(count, length, _COUNT).tobytes() + places.table.astype(_NUMBER).tobytes()
    lengths = np.fromiter(map(len, places), _COUNT, len(places))
    return lengths.tobytes() + np.fromiter(chain.from_iterable(places), _NUMBER).tobytes()


def unpacked_places(data: bytes, count: int, what: str) -> Sequence[Place]:
    """The places of `count` nodes or senders. Raises ProtocolError for other data."""
    if not (data or count):
        return []
    begin = count * _COUNT.itemsize
    lengths = np.frombuffer(data[:begin], _COUNT) if len(data) >= begin else None
    # Below 2^64, as there are fewer than 2^32 numbers below 2^32.
    total = -1 if lengths is None else int(lengths.sum(dtype=np.uint64))
    if lengths is None or len(data) - begin != total * _NUMBER.itemsize:
        raise ProtocolError(f"parcel: {what} has {len(data)} bytes, which are not {count} places")
    if (lengths % 2 == 0).any():
        raise ProtocolError(f"parcel: {what}: a place must have an odd number of numbers")
    if count and (lengths == lengths[0]).all():
        return PlaceTable(np.frombuffer(data[begin:], _NUMBER).reshape(count, -1))
    numbers: list[int] = np.frombuffer(data[begin:], _NUMBER).tolist()
    ends = [0, *np.cumsum(lengths, dtype=np.int64).tolist()]
    return [tuple(numbers[first:last]) for first, last in pairwise(ends)]
