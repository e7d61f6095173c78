"""Ids of newborns: made from the parent's, so that they are the same wherever a world runs."""

from __future__ import annotations

from hashlib import blake2b

import numpy as np
from numpy.typing import NDArray

from minerva_bus.grammar.ids import LONGEST, Ids


def child_id(parent: str, births: int) -> str:
    """An id that only this birth gives; a lineage too long to be spelled out is hashed."""
    name = f"{parent}:{births}"
    if len(name) <= LONGEST:
        return name
    lineage = blake2b(name.encode(), digest_size=12).hexdigest()
    return f"{parent[:16].split(':')[0]}:-{lineage}"


def child_ids(parents: Ids, births: NDArray[np.int64]) -> Ids:
    """The ids of one birth of each parent; those of `child_id`."""
    names = np.strings.add(np.strings.add(parents.spelled, b":"), births.astype("S20"))
    longest = int(np.strings.str_len(names).max())
    if longest <= LONGEST:
        return Ids(None, names.astype(f"S{longest}")).sound_like((parents,))
    texts = [child_id(*pair) for pair in zip(parents.texts(), births.tolist(), strict=True)]
    return Ids.of(texts).sound_like((parents,))
