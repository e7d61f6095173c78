"""The canonical text of a string: parse(text(w)) = w."""

import json
from typing import Final

import numpy as np

from minerva_bus.grammar.columns import bits
from minerva_bus.grammar.scene import AgentNode, Array, FigureNode, Node, Scene, Value, walk
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
    return value if isinstance(value, bool | int | float | str) else value_text(value)


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
