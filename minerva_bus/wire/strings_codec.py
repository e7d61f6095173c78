"""Values, strings and events as plain data: section 3 of PROTOCOL.md.

A string is flat, in reading order, so that its depth costs no recursion:

    scene  = [count of top pieces, piece, piece, ...]   each node is followed by its scope's
    piece  = node | columns                             nodes of one shape (columns_codec.py)
    node   = [symbol, values]                           figure
           | [symbol, values, count]                    transformation
           | [symbol, id, values, count]                agent; values is nil if it has none,
                                                        and for a mere slot
    event  = [type, values] | [type, values, condition, sender, [receivers]]
           | events                                     a batch of one type (columns_codec.py)

`values` are in the order of the vocabulary's fields. A matrix is extension 1 (a byte `i` or `r`,
rows and columns as little-endian uint32, then int16 or float64 values in row order, little
endian); a string as a value is extension 2 (a packed scene).
"""

from __future__ import annotations

import re
import struct
from collections.abc import Container, Iterable, Sequence
from itertools import chain, repeat
from operator import itemgetter
from typing import Any, Final, cast

import msgpack
import numpy as np

from minerva_bus.errors import ProtocolError, VocabularyError
from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.events import AnyEvent, Event, Events
from minerva_bus.grammar.fields import Fields
from minerva_bus.grammar.ids import Ids, repeated_id, same_id
from minerva_bus.grammar.scene import (
    AGENT_ID,
    DEPTH,
    EMPTY,
    AgentNode,
    FigureNode,
    Node,
    Piece,
    Scene,
    TransformationNode,
    Value,
    agents,
)
from minerva_bus.grammar.types import Unfit
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.wire.columns_codec import ColumnsReader, plain_columns
from minerva_bus.wire.columns_codec import plain_events as plain_batch
from minerva_bus.wire.plain import (
    DEFAULT,
    STRING,
    Limits,
    as_int,
    as_list,
    as_text,
    name_of,
    unpack,
)

MATRIX = 1
"""Extension type of a matrix."""
HEADER = struct.Struct("<cII")
"""Head of a matrix: the kind of its numbers, rows and columns."""
PLAIN_TYPES = frozenset((float, int, bool, str))


# --- to plain data ---


def plain_value(value: Value) -> Any:
    """A value as plain data."""
    if isinstance(value, np.ndarray):
        real = value.dtype == np.float64
        cells = np.ascontiguousarray(value, "<f8" if real else "<i2")
        head = HEADER.pack(b"r" if real else b"i", *value.shape)
        return msgpack.ExtType(MATRIX, b"".join((head, cells.data)))
    if isinstance(value, Scene):
        return msgpack.ExtType(STRING, msgpack.packb(plain_scene(value)))
    if isinstance(value, tuple):
        if PLAIN_TYPES.issuperset(map(type, value)) or are_plain_lists(value, tuple):
            return list(value)
        return [plain_value(item) for item in value]
    return value


def plain_scene(scene: Scene) -> list[Any]:
    """A string as a flat list, so that its depth costs no recursion."""
    flat: list[Any] = [len(scene.pieces)]
    stack = [iter(scene.pieces)]
    while stack:
        for piece in stack[-1]:
            if isinstance(piece, Columns):
                flat.append(plain_columns(piece))
                continue
            flat.append(_plain_node(piece))
            # The iterator of this level stays on the stack and continues after the scope.
            if not isinstance(piece, FigureNode) and piece.scope.pieces:
                stack.append(iter(piece.scope.pieces))
                break
        else:
            stack.pop()
    return flat


def _plain_node(node: Node) -> list[Any]:
    values = _plain_values(node.values)
    if isinstance(node, FigureNode):
        return [node.symbol, values]
    if isinstance(node, TransformationNode):
        return [node.symbol, values, len(node.scope.pieces)]
    return [node.symbol, node.id, values if node.names else None, len(node.scope.pieces)]


def _plain_values(values: Sequence[Value]) -> list[Any]:
    if PLAIN_TYPES.issuperset(map(type, values)):  # The usual case: nothing to convert.
        return list(values)
    return [value if value.__class__ in PLAIN_TYPES else plain_value(value) for value in values]


def plain_event(event: AnyEvent) -> list[Any]:
    """An event, or a batch."""
    if isinstance(event, Events):
        return plain_batch(event)
    values = _plain_values(event.values)
    if event.condition or event.sender or event.receivers:
        return [event.type, values, event.condition, event.sender, list(event.receivers)]
    return [event.type, values]


def plain_event_list(events: Sequence[AnyEvent]) -> list[Any]:
    """Events in order."""
    return [plain_event(event) for event in events] if events else []


def are_plain_lists(items: Sequence[Any], kind: type[Any]) -> bool:
    """Whether all items are lists (of the type `kind`) of plain values.

    Decided without a call for each of them, because a message may have tens of thousands.
    """
    if not {kind}.issuperset(map(type, items)):
        return False
    return PLAIN_TYPES.issuperset(map(type, chain.from_iterable(items)))


# --- from plain data ---

_MAX_ERROR_CHARS = 300
_ITEMS = {"P": 2, "T": 3, "A": 4}
"""Items of a node by the first letter of its symbol."""


class Reader(ColumnsReader):
    """Reads values by a vocabulary; all results are typed and within the limits.

    Raises ProtocolError, and VocabularyError for unknown symbols and wrong types.
    """

    def __init__(self, vocabulary: Vocabulary, limits: Limits = DEFAULT) -> None:
        super().__init__(vocabulary, limits)
        self._depth = 0
        self._slots = False
        self._ids: set[str] = set()
        self._columns_ids: list[Ids] = []

    def value(self, plain: Any) -> Any:
        """A value, before it is fitted to a type."""
        kind: type[Any] = plain.__class__
        if kind in PLAIN_TYPES:
            return plain
        if kind is msgpack.ExtType and plain.code == MATRIX:
            return _matrix(plain.data)
        if kind is not list and kind is not msgpack.ExtType:
            raise ProtocolError(f"a value cannot be {name_of(plain)}")
        # Values are read recursively, so their nesting must be bounded, unlike that of scopes. A
        # context manager would cost more than the rest: most lists are short or flat.
        if self._depth >= DEPTH:
            raise ProtocolError(f"values are nested more than {DEPTH} deep")
        self._depth += 1
        try:
            return self._items(plain) if kind is list else self._extension(plain)
        finally:
            self._depth -= 1

    def _items(self, items: list[Any]) -> tuple[Any, ...]:
        # Most lists are long and flat, such as routes.
        if PLAIN_TYPES.issuperset(map(type, items)):
            return tuple(items)
        if self._depth < DEPTH and are_plain_lists(items, list):
            return tuple(map(tuple, items))
        return tuple([self.value(item) for item in items])

    def _extension(self, extension: msgpack.ExtType) -> Scene:
        if extension.code != STRING:
            raise ProtocolError(f"extension {extension.code} is unknown")
        return self.scene(unpack(extension.data, self.limits))

    def view(self, plain: Any) -> Scene:
        """A string of L(E), which has no agents."""
        scene = self.scene(plain)
        agent = next(agents(scene), None)
        if agent is not None:
            raise ProtocolError(f"a view holds the agent {agent.symbol}#{agent.id}")
        return scene

    def skeleton(self, plain: Any) -> Scene:
        """A string whose agents are slots: without state and scope."""
        # Slots are accepted in skeletons only: anywhere else an agent without state is an error.
        self._slots = True
        try:
            return self.scene(plain)
        finally:
            self._slots = False

    def scene(self, plain: Any) -> Scene:
        """A string of the vocabulary, in which ids are unique."""
        # A string that is a value within another one has ids of its own.
        outer, self._ids, self._columns_ids = (self._ids, self._columns_ids), set(), []
        try:
            scene = self._scene(as_list(plain, "a string"))
            self._check_ids()
            return scene
        finally:
            self._ids, self._columns_ids = outer

    def _check_ids(self) -> None:
        """Raise ProtocolError for an id that is in several columns, or in columns and a node."""
        repeated = repeated_id(self._columns_ids, self._ids)
        if repeated is not None:
            raise ProtocolError(same_id(repeated)[:_MAX_ERROR_CHARS])

    def _scene(self, flat: list[Any]) -> Scene:
        if not flat:
            raise ProtocolError("a string must begin with its count")
        # The length is checked before any node is made.
        if len(flat) > self.limits.nodes:
            raise ProtocolError(f"a string of {len(flat)} symbols, over {self.limits.nodes}")
        wanted = [as_int(flat[0], "the count of a string")]
        opened: list[tuple[Any, ...]] = []
        levels: list[list[Piece]] = [[]]
        place, single = 1, 1
        while place < len(flat):
            if not wanted[-1]:
                raise ProtocolError("a string has data after its end")
            # A run that cannot be read together is read node by node, up to `single`.
            end = end_of_run(flat, place, wanted[-1]) if place >= single else 0
            nodes = self._run(flat[place:end]) if end > place else ()
            single, count = max(single, end), len(nodes) or 1
            wanted[-1] -= count
            if nodes:
                levels[-1] += nodes
            elif inner := self._piece(as_list(flat[place], "a symbol"), levels[-1], opened):
                wanted.append(inner)
                levels.append([])
            place += count
            # A node may end the scopes of several nodes around it.
            while len(wanted) > 1 and not wanted[-1]:
                wanted.pop()
                scope = Scene(tuple(levels.pop()))
                levels[-1].append(_close(opened.pop(), scope))
            if len(wanted) > self.limits.depth:
                raise ProtocolError(f"a string is nested more than {self.limits.depth} deep")
        if wanted[-1] or len(wanted) > 1:
            raise ProtocolError("a string is cut off")
        return Scene(tuple(levels[0])) if levels[0] else EMPTY

    def _piece(self, piece: list[Any], level: list[Piece], opened: list[tuple[Any, ...]]) -> int:
        if piece and type(piece[0]) is int:
            columns = self.columns(piece)
            if columns.ids is not None:
                self._columns_ids.append(columns.ids)
            level.append(columns)
            return 0
        return self._node(piece, level, opened)

    def _run(self, run: list[list[Any]]) -> Sequence[Node]:
        """The nodes of a run, or none if they must be read one by one."""
        symbol = run[0][0]
        # Only skeletons have slots; unknown symbols are reported with a single node.
        if self._slots or len(run[0]) != _ITEMS.get(symbol[:1]):
            return ()
        try:
            fields = self.vocabulary.fields(symbol)
        except Unfit:
            return ()
        nodes = nodes_of(run, fields, self._ids)
        if symbol[:1] == "A":
            self._ids.update([node.id for node in cast("Sequence[AgentNode]", nodes)])
        return nodes

    def _node(self, node: list[Any], level: list[Piece], opened: list[tuple[Any, ...]]) -> int:
        """Read one symbol; a figure, or a node with an empty scope, is complete at once."""
        symbol = as_text(node[0] if node else None, "a symbol")
        kind = symbol[:1]
        if len(node) != _ITEMS.get(kind, 0):
            raise ProtocolError(f"{symbol[:40]!r} with {len(node) - 1} items is not a symbol")
        agent_id = self._new_id(node[1]) if kind == "A" else ""
        names, values = self._values(symbol, agent_id, node[2] if kind == "A" else node[1])
        if kind == "P":
            level.append(FigureNode(symbol, names, values))
            return 0
        count = as_int(node[-1], "the count of a scope")
        head = (symbol, agent_id, names, values)
        if count:
            opened.append(head)
        else:
            level.append(_close(head, EMPTY))
        return count

    def _new_id(self, plain: Any) -> str:
        agent_id = self._id(plain)
        if agent_id in self._ids:
            raise ProtocolError(same_id(agent_id)[:_MAX_ERROR_CHARS])
        self._ids.add(agent_id)
        return agent_id

    def _id(self, plain: Any) -> str:
        # The usual case, without further calls.
        if plain.__class__ is str and AGENT_ID.fullmatch(plain) is not None:
            return plain
        agent_id = as_text(plain, "an id")
        # Slots may have the name of a part, such as ~AFox.1, which is not a valid agent id.
        plain_id = agent_id.removeprefix("~").replace(".", "_") if self._slots else agent_id
        if AGENT_ID.fullmatch(plain_id) is None:
            raise ProtocolError(f"{agent_id[:40]!r} is not a valid agent id")
        return agent_id

    def _values(self, symbol: str, agent_id: str, plain: Any):
        owner = symbol
        try:
            fields = self.vocabulary.fields(symbol)
            if plain.__class__ is list and fields.is_final(plain):  # The usual case.
                return fields.names, tuple(plain)
            owner = f"{symbol}#{agent_id}" if agent_id else symbol
            if plain is None and agent_id and (self._slots or not fields.names):
                return (), ()
            given = self._data(owner, plain)
            if len(given) != len(fields.names):
                raise Unfit(f"{owner} has {len(given)} values; expected {len(fields.names)}")
            # Values are fitted to the declared types here, so all decoded values are typed.
            return fields.refit(owner, fields.names, given)
        except Unfit as unfit:
            raise VocabularyError(str(unfit)[:_MAX_ERROR_CHARS], source="fragment") from None

    def event(self, plain: Any) -> AnyEvent:
        """An event of the vocabulary, or a batch."""
        items = as_list(plain, "an event")
        if len(items) == 6:
            return self.batch(items)
        if len(items) not in (2, 5):
            raise ProtocolError(f"an event must have 2, 5 or 6 items, not {len(items)}")
        declared = self.event_type(items[0])
        name = declared.name
        condition, sender, receivers = "", "", ()
        if len(items) == 5:
            condition, sender = as_text(items[2], "a condition"), as_text(items[3], "a sender")
            if condition:
                self.vocabulary.check_condition(name, condition, "event")
            if sender:
                self._id(sender)
            ids = [self._id(item) for item in as_list(items[4], "receivers")]
            # Sorted and unique, because equal events of different members must compare equal.
            receivers = tuple(sorted(set(ids))) if len(ids) > 1 else tuple(ids)
        fields = declared.fields
        if items[1].__class__ is list and fields.is_final(items[1]):  # The usual case.
            return Event(name, fields.names, tuple(items[1]), condition, sender, receivers)
        given = self._data(name, items[1])
        if len(given) != len(fields.names):
            wanted = ", ".join(fields.names) or "no data"
            raise VocabularyError(
                f"{name} has {len(given)} data; expected {wanted}", source="event"
            )
        try:
            names, values = fields.refit(name, fields.names, given)
        except Unfit as unfit:
            raise VocabularyError(str(unfit)[:_MAX_ERROR_CHARS], source="event") from None
        return Event(name, names, values, condition, sender, receivers)

    def _data(self, name: str, plain: Any) -> tuple[Any, ...]:
        items = as_list(plain, f"the values of {name}")
        # The usual case: scalars, which are values as they are.
        if PLAIN_TYPES.issuperset(map(type, items)):
            return tuple(items)
        return tuple(
            [item if item.__class__ in PLAIN_TYPES else self.value(item) for item in items]
        )

    def events(self, plain: Any) -> tuple[AnyEvent, ...]:
        """Events in order."""
        items = as_list(plain, "events")
        # The declared counts of batches are added up before any of them is read.
        count = sum(map(_count, items))
        if count > self.limits.events:
            raise ProtocolError(f"{count} events at once, over {self.limits.events}")
        return tuple([self.event(item) for item in items])


def _count(plain: Any) -> int:
    """The declared number of events of an item."""
    items = as_list(plain, "an event")
    size = items[1] if len(items) == 6 else 1
    return max(1, size) if type(size) is int else 1


def _close(head: tuple[Any, ...], scope: Scene) -> Node:
    symbol, agent_id, names, values = head
    if agent_id:
        return AgentNode(symbol, agent_id, names, values, scope)
    return TransformationNode(symbol, names, values, scope)


def _matrix(data: bytes) -> Any:
    if len(data) < HEADER.size:
        raise ProtocolError("a matrix is cut off")
    kind, rows, columns = HEADER.unpack_from(data)
    if kind not in (b"i", b"r"):
        raise ProtocolError(f"a matrix of kind {kind!r}; expected b'i' or b'r'")
    dtype = np.dtype("<i2" if kind == b"i" else "<f8")
    # Python's integers cannot overflow, so sizes near 2^64 do not pass.
    if len(data) - HEADER.size != rows * columns * dtype.itemsize:
        raise ProtocolError(f"a matrix of {rows}x{columns} has {len(data) - HEADER.size} bytes")
    return np.frombuffer(data, dtype, offset=HEADER.size).reshape(rows, columns)


# --- runs of flat nodes of one symbol, which are read together ---

# Most nodes of a large string stand beside others of their kind. The checks of a node in Python
# cost more than everything else, so those of a run are done by calls for all of its nodes.

RUN: Final = 8
"""Nodes from which on a run is read together."""

_IDS: Final = re.compile(rf"(?:{AGENT_ID.pattern}+\n)*+")


def end_of_run(flat: list[Any], begin: int, most: int) -> int:
    """The end of the run of nodes without scopes that begins there, of at most `most` nodes."""
    first, end = flat[begin], min(len(flat), begin + most)
    if end - begin < RUN or first.__class__ is not list or not first:
        return begin
    # Columns begin with their number of rows.
    if first[0].__class__ is not str or not _is_like(first, first):
        return begin
    for place in range(begin + 1, end):
        if not _is_like(flat[place], first):
            return place if place - begin >= RUN else begin
    return end


def _is_like(node: Any, first: Any) -> bool:
    """Whether a node has the symbol of the first one, as many items, and no scope."""
    return (
        node.__class__ is list
        and len(node) == len(first) > 1
        and node[0] == first[0]
        # A figure ends with its values, which are never 0.
        and (node[-1] == 0 or len(node) == 2)
    )


def nodes_of(run: list[list[Any]], fields: Fields, known: Container[str]) -> list[Node]:
    """The nodes of a run, whose values have these fields and whose ids are not `known`.

    Empty if any of them needs the checks for single nodes, or would fail them.
    """
    symbol, names = run[0][0], fields.names
    is_agent = symbol[:1] == "A"
    values = _values(list(map(itemgetter(2 if is_agent else 1), run)), fields)
    if values is None or (len(run[0]) > 2 and set(map(type, map(itemgetter(-1), run))) != {int}):
        return []
    if not is_agent:
        if symbol[:1] == "P":
            return list(map(FigureNode, repeat(symbol), repeat(names), values))
        return list(map(TransformationNode, repeat(symbol), repeat(names), values))
    ids = list(map(itemgetter(1), run))
    if not _are_new(ids, known):
        return []
    return list(map(AgentNode, repeat(symbol), ids, repeat(names), values, repeat(EMPTY)))


def _values(plain: list[Any], fields: Fields) -> Iterable[tuple[Any, ...]] | None:
    """The values of each node if they are as declared, otherwise None."""
    if set(map(type, plain)) != {list} or set(map(len, plain)) != {len(fields.names)}:
        return None
    return map(tuple, plain) if fields.are_final(zip(*plain, strict=True)) else None


def _are_new(ids: list[Any], known: Container[str]) -> bool:
    """Whether these are valid ids that differ from each other and from the known ones."""
    if set(map(type, ids)) != {str} or len(set(ids)) < len(ids):
        return False
    if any(map(known.__contains__, ids)):
        return False
    lines = "\n".join(ids) + "\n"
    return lines.count("\n") == len(ids) and _IDS.fullmatch(lines) is not None
