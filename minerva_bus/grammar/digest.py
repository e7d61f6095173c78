"""Digests of strings: equal exactly for strings that print the same.

The digest of a string is BLAKE2b-128 over the digests of its nodes, one after another; that of a
node is BLAKE2b-128 over its head's text (UTF-8), a zero byte and, where it has a scope, the
scope's digest. In a head's text a matrix stands as `RxC[#hex]`, hex being the BLAKE2b-128 of its
values in row order (int16, or float64 where the text says `RxCr`, little endian), so that big
matrices need not be printed.
"""

from __future__ import annotations

from collections.abc import Iterator
from hashlib import blake2b
from math import copysign

import numpy as np

from minerva_bus.grammar.printer import bits, shape_text, value_text
from minerva_bus.grammar.scene import (
    AgentNode,
    Array,
    FigureNode,
    Node,
    Scene,
    TransformationNode,
    Value,
)

SIZE = 16


def scene_digest(scene: Scene) -> bytes:
    """16 bytes for a string; digests of nodes and scopes are kept with them and used again."""
    nodes, parts = iter(scene.nodes), list[bytes]()
    opened: list[tuple[TransformationNode | AgentNode, Iterator[Node], list[bytes]]] = []
    while True:
        for node in nodes:
            digest = _known(node)
            if digest:
                parts.append(digest)
            elif isinstance(node, FigureNode):
                parts.append(_kept(node, _hash(_head(node) + b"\0")))
            else:
                opened.append((node, nodes, parts))
                nodes, parts = iter(node.scope.nodes), []
                break
        else:
            digest = _hash(b"".join(parts))
            if not opened:
                return digest
            done, nodes, parts = opened.pop()
            digest = _kept(done.scope, digest)
            parts.append(_kept(done, _hash(_head(done) + b"\0" + digest)))


def _known(item: Scene | Node) -> bytes:
    return getattr(item, "_digest", b"")


def _kept(item: Scene | Node, digest: bytes) -> bytes:
    object.__setattr__(item, "_digest", digest)  # a cache: the value itself stays immutable
    return digest


def _hash(data: bytes) -> bytes:
    return blake2b(data, digest_size=SIZE).digest()


def _head(node: Node) -> bytes:
    name = f"{node.symbol}#{node.id}" if isinstance(node, AgentNode) else node.symbol
    if node.names:
        pairs = zip(node.names, node.values, strict=True)
        name = f"{name}<{', '.join([f'{n}={_value(v)}' for n, v in pairs])}>"
    return name.encode()


def _value(value: Value) -> str:
    if isinstance(value, np.ndarray):
        return f"{shape_text(value)}[#{_hash(value.tobytes()).hex()}]"
    if isinstance(value, Scene):
        return f"{{#{value.digest.hex()}}}"
    if isinstance(value, tuple):
        return f"[{', '.join([_value(item) for item in value])}]"
    return value_text(value)


def same_values(a: tuple[Value, ...], b: tuple[Value, ...]) -> bool:
    """Whether two tuples of values have the same types and print the same."""
    return a is b or (len(a) == len(b) and all(map(_same, a, b)))


def _same(a: Value, b: Value) -> bool:
    if a is b:
        return True
    if isinstance(a, np.ndarray):
        return isinstance(b, np.ndarray) and _same_matrices(a, b)
    if isinstance(a, tuple):
        return isinstance(b, tuple) and same_values(a, b)
    if isinstance(a, float):  # 0.0 == -0.0, but they do not print the same
        return type(b) is float and a == b and copysign(1.0, a) == copysign(1.0, b)
    return type(a) is type(b) and a == b


def _same_matrices(a: Array, b: Array) -> bool:
    return a.dtype == b.dtype and a.shape == b.shape and bool((bits(a) == bits(b)).all())
