"""The canonical text of a string, parse(text(w)) = w, and its digest.

Digests are equal exactly if the strings print the same. The digest of a string is BLAKE2b-128 over
the digests of its parts in order. A part is a node, or a maximal run of 32 or more neighbours of
one shape (grammar/columns.py).

The digest of a node is BLAKE2b-128 over the text of its head (UTF-8), a zero byte and, if it has a
scope, the digest of the scope. In this text a matrix is `RxC[#hex]`, where hex is the BLAKE2b-128
of its values in row order (int16, or float64 in the case of `RxCr`, little endian), so that large
matrices need not be printed.

The digest of a run is BLAKE2b-128 over the text `COUNT`, a zero byte and, for each level of the
shape, the text `SYMBOL<NAME,...>`, a zero byte and the digests of its ids (agents only) and of its
columns, 16 bytes each. The digest of a column is BLAKE2b-128 over those of its chunks of 4,096
values, and the digest of a chunk is BLAKE2b-128 over

    `n` and float64 values, little endian     if all are numbers that float64 represents exactly and
                                              that are of type real, or whole and below 10^16
    `b` and bytes 0 or 1                      if all are bools
    `t` and the text of each value with a line feed, otherwise; ids are texts without quotes

so that an unchanged chunk is not hashed again.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from functools import lru_cache
from hashlib import blake2b
from math import copysign
from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from minerva_bus.grammar.columns import CHUNK, MANY, Column, Columns, bits, merged, runs, size
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.scene import (
    AgentNode,
    Array,
    FigureNode,
    Node,
    Piece,
    Scene,
    TransformationNode,
    Value,
    walk,
)
from minerva_bus.grammar.types import Quantity
from minerva_bus.wording import short

CONCATENATION = " · "
LONGEST_MATRIX: Final = 9
"""Cells of the largest matrix that is shown with its values."""

# `json.dumps` with an option makes an encoder for each call.
_quoted: Final = json.JSONEncoder(ensure_ascii=False).encode


def text(scene: Scene) -> str:
    """The canonical text of a string; the empty text for ε."""
    parts: list[str] = []
    first = True
    for opens, node in walk(scene):
        if not opens:
            parts.append(")")
            first = False
            continue
        if not first:
            parts.append(CONCATENATION)
        parts.append(head(node))
        first = False
        if not isinstance(node, FigureNode):
            parts.append("(")
            first = True
    return "".join(parts)


def head(node: Node) -> str:
    """A node without its scope: `TMove<dist=1.5>`."""
    name = f"{node.symbol}#{node.id}" if isinstance(node, AgentNode) else node.symbol
    if not node.names:
        return name
    pairs = zip(node.names, node.values, strict=True)
    return f"{name}<{', '.join([f'{n}={value_text(v)}' for n, v in pairs])}>"


def json_value(value: Value) -> bool | int | float | str:
    """The value itself if JSON has it, otherwise its canonical text."""
    return value if isinstance(value, (bool, int, float, str)) else value_text(value)


def value_text(value: Value) -> str:
    """The canonical text of one value."""
    if isinstance(value, str):
        return _quoted(value)
    # Before int, because a bool is an int.
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        return number_text(value)
    if isinstance(value, tuple):
        return f"[{', '.join([value_text(item) for item in value])}]"
    if isinstance(value, Scene):
        return f"{{{text(value)}}}"
    if isinstance(value, Quantity):
        return f"{number_text(value.number)}{value.unit}"
    return _matrix_text(value)


def shown_value(value: Value, longest: int = 2000) -> str:
    """A value as text of at most `longest` characters, of a large matrix its shape."""
    if isinstance(value, np.ndarray) and value.size > LONGEST_MATRIX:
        return shape_text(value)
    return short(value_text(value), longest)


def number_text(number: float) -> str:
    """The shortest text that is read as the same number; whole numbers have no point."""
    shown = repr(float(number))
    # "-0" would be read as an integer, which has no negative zero.
    return shown if shown[-2:] != ".0" or shown == "-0.0" else shown[:-2]


def _matrix_text(matrix: Array) -> str:
    """`2x3[0*4 1 0]`: rows, columns, then runs of equal values in row order; `2x3r[` for reals."""
    # Runs are found by bits, because 0.0 and -0.0 are equal but print differently.
    flat, raw = matrix.ravel(), bits(matrix).ravel()
    starts = np.flatnonzero(np.concatenate(([True], raw[1:] != raw[:-1])))[: flat.size]
    lengths = np.diff(np.append(starts, flat.size))
    runs = [
        f"{number_text(value)}*{length}" if length > 1 else number_text(value)
        for value, length in zip(flat[starts].tolist(), lengths.tolist(), strict=True)
    ]
    return f"{shape_text(matrix)}[{' '.join(runs)}]"


def shape_text(matrix: Array) -> str:
    """`2x3`, followed by `r` if the values are reals."""
    return f"{matrix.shape[0]}x{matrix.shape[1]}{'r' if matrix.dtype == np.float64 else ''}"


# --- digests ---

SIZE = 16
_EXACT: Final = 1 << 53
_FLOATS: Final = frozenset((float,))
_WHOLE: Final = 10**16  # From here on, a float prints differently from an equal int.


def scene_digest(scene: Scene) -> bytes:
    """The digest of a string, 16 bytes; digests of nodes and scopes are cached in them."""
    # A stack of its own: strings may be nested more deeply than Python recurses.
    nodes = _parts(scene)
    parts: list[bytes] = []
    opened: list[
        tuple[TransformationNode | AgentNode, Iterator[Piece | list[Columns]], list[bytes]]
    ] = []
    while True:
        # `parts` has the digests of the current scope, `opened` the nodes around it with theirs. A
        # node is digested when its scope is complete.
        for node in nodes:
            digest = _known(node)
            if digest:
                parts.append(digest)
            elif isinstance(node, list):
                parts.append(_digest_of_many(node))
            elif isinstance(node, Columns):
                parts.append(_kept(node, _digest_of_many([node])))
            elif isinstance(node, FigureNode):
                parts.append(_kept(node, _hash(_head(node) + b"\0")))
            elif known := _known(node.scope):
                parts.append(_kept(node, _hash(_head(node) + b"\0" + known)))
            else:
                opened.append((node, nodes, parts))
                nodes, parts = _parts(node.scope), []
                break
        else:
            digest = _hash(b"".join(parts))
            if not opened:
                return digest
            done, nodes, parts = opened.pop()
            digest = _kept(done.scope, digest)
            parts.append(_kept(done, _hash(_head(done) + b"\0" + digest)))


def _parts(scene: Scene) -> Iterator[Piece | list[Columns]]:
    """Nodes, and runs of one shape as columns, independent of the string's representation.

    Neighbouring columns that are cut at chunk borders are not merged.
    """
    pieces = scene.pieces
    if len(pieces) < MANY and not any(type(piece) is Columns for piece in pieces):
        return iter(pieces)
    return _grouped(pieces)


def _grouped(pieces: tuple[Piece, ...]) -> Iterator[Piece | list[Columns]]:
    for shape, group in runs(pieces):
        if shape is None:
            yield from group
        elif len(group) > 1 and _aligned(group):
            yield cast("list[Columns]", group)
        elif size(group) >= MANY:
            yield merged(group)
        else:
            # Fewer than `MANY` are digested one by one, even if they are held in columns: the
            # digest must not depend on the representation.
            yield from Scene(tuple(group)).nodes


def _aligned(group: Sequence[Piece]) -> bool:
    """Whether these are columns, of which all but the last consist of complete chunks."""
    # Columns cut at chunk borders have the chunks of the joined column, whose digests are cached.
    whole_chunks = all(piece.count % CHUNK == 0 for piece in group[:-1])  # Nodes have count 1.
    return whole_chunks and isinstance(group[-1], Columns)


def _digest_of_many(pieces: Sequence[Columns]) -> bytes:
    parts = [f"{size(pieces)}\0".encode()]
    for levels in zip(*[part.levels() for part in pieces], strict=True):
        first = levels[0]
        parts.append(f"{first.symbol}<{','.join(first.names)}>\0".encode())
        if first.ids is not None:
            parts.append(
                _hash(b"".join([_chunks_of_ids(cast("Ids", level.ids)) for level in levels]))
            )
        for columns in zip(*[level.columns for level in levels], strict=True):
            parts.append(_hash(b"".join(map(_chunks_of_column, columns))))
    return _hash(b"".join(parts))


def _chunks_of_ids(ids: Ids) -> bytes:
    if not ids.chunks:
        spans = range(0, len(ids), CHUNK)
        chunks = [_hash(b"t" + ids.text_of(slice(at, at + CHUNK))) for at in spans]
        ids.chunks = b"".join(chunks)
    return ids.chunks


def _chunks_of_column(column: Column) -> bytes:
    array = column.array
    chunks = column.chunks  # Another thread may be hashing the same column.
    if chunks is None:
        chunks = column.chunks = [b""] * -(-len(array) // CHUNK)
    for number, digest in enumerate(chunks):
        if not digest:
            at = number * CHUNK
            chunks[number] = _digest_of_chunk(array[at : at + CHUNK])
    return b"".join(chunks)


def _digest_of_chunk(values: NDArray[Any]) -> bytes:
    kind = values.dtype.kind
    # Integers up to 2^53 are exact as float64. They share a digest with equal floats, which print
    # the same.
    if kind == "f" or (
        kind == "i" and int(values.max()) <= _EXACT and int(values.min()) >= -_EXACT
    ):
        return _hash_two(b"n", values.astype("<f8", copy=False))
    if kind == "b":
        return _hash_two(b"b", values.view(np.uint8))
    # Texts, and columns with values of several types.
    listed = cast("list[Value]", values.tolist())
    types = set(map(type, listed))
    if types == {bool}:
        return _hash_two(b"b", np.array(listed, np.uint8))
    if types <= {int, float} and all(_exact(entry) for entry in listed):
        return _hash_two(b"n", np.array(listed, "<f8"))
    return _hash(b"t" + b"".join([f"{value_text(entry)}\n".encode() for entry in listed]))


def _exact(number: Any) -> bool:
    return type(number) is float or (abs(number) < _WHOLE and int(float(number)) == number)


def _hash_two(kind: bytes, values: NDArray[Any]) -> bytes:
    # In two steps, because joining kind and values would copy the values.
    hashing = blake2b(kind, digest_size=SIZE)
    hashing.update(np.ascontiguousarray(values).data)
    return hashing.digest()


def _known(item: Scene | Piece | list[Columns]) -> bytes:
    return getattr(item, "_digest", b"")


def _kept(item: Scene | Piece, digest: bytes) -> bytes:
    object.__setattr__(item, "_digest", digest)  # a cache: the value itself stays immutable
    return digest


def _hash(data: bytes) -> bytes:
    return blake2b(data, digest_size=SIZE).digest()


def _head(node: Node) -> bytes:
    name = f"{node.symbol}#{node.id}" if isinstance(node, AgentNode) else node.symbol
    if node.names:
        name = f"{name}<{_filled(_places(node.names), node.values)}>"
    return name.encode()


def _filled(places: str, values: tuple[Value, ...]) -> str:
    if _FLOATS.issuperset(map(type, values)):
        # `repr` of a float is its canonical text, except for whole numbers.
        text = places % (*map(repr, values),)
        # Whole numbers print without a point, but for the negative zero.
        if "-0.0," not in f"{text},":
            return text.replace(".0,", ",").removesuffix(".0")
    return places % (*map(_value, values),)


@lru_cache(1024)
def _places(names: tuple[str, ...]) -> str:
    """A format string with the names and a place for each value."""
    return ", ".join([f"{name}=%s" for name in names])


def _value(value: Value) -> str:
    if type(value) is float:  # The most frequent type.
        return number_text(value)
    if isinstance(value, np.ndarray):
        return f"{shape_text(value)}[#{_hash(value.tobytes()).hex()}]"
    if isinstance(value, Scene):
        return f"{{#{value.digest.hex()}}}"
    if isinstance(value, tuple):
        return f"[{', '.join([_value(item) for item in value])}]"
    return value_text(value)


def same_values(a: tuple[Value, ...], b: tuple[Value, ...]) -> bool:
    """Whether two tuples of values have the same types and print the same."""
    if a is b:
        return True
    if len(a) != len(b):
        return False
    # Most are the same objects, which take no call here.
    for was, now in zip(a, b, strict=True):  # noqa: SIM110
        if was is not now and not _same(was, now):
            return False
    return True


def _same(a: Value, b: Value) -> bool:
    if isinstance(a, np.ndarray):
        return isinstance(b, np.ndarray) and _same_matrices(a, b)
    if isinstance(a, tuple):
        return isinstance(b, tuple) and same_values(a, b)
    if isinstance(a, float):  # 0.0 == -0.0, but they do not print the same
        return type(b) is float and a == b and copysign(1.0, a) == copysign(1.0, b)
    return type(a) is type(b) and a == b


def _same_matrices(a: Array, b: Array) -> bool:
    if a.dtype != b.dtype or a.shape != b.shape:
        return False
    first, second = bits(a), bits(b)
    # The last number, of the last row of a table, costs a tenth of a comparison of small matrices.
    if first.size and first.item(-1) != second.item(-1):
        return False
    # Most matrices that a frame has changed differ in a few of their numbers.
    if first.size > _LARGE and not (first[..., ::_STEP] == second[..., ::_STEP]).all():
        return False
    return bool((first == second).all())


_LARGE: Final = 4096
"""Numbers of a matrix that take longer to compare than a few of them."""
_STEP: Final = 128
"""Columns between those that are compared first."""
