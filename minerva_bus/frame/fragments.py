"""Fragments: outermost agents and parts of populations, their names, and shares of hosts."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Final, TypeAlias, cast

import numpy as np

from minerva_bus.grammar.column import CHUNK
from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.scene import AgentNode, Scene

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
