"""Ids of newborns and copies, derived from other ids: equal wherever a world runs.

    a:3        the third child of #a, by the count in its state
    a:7-2      the second copy of #a that frame 7 makes under the literal policy (equation 3)
    a:7-2-3    #a in the second copy of an agent around it; 3 is its height (see `copy_id`)

The form of the suffix determines the rule, so two rules, parents, frames or copies never give the
same id. An id longer than `LONGEST` is hashed.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from hashlib import blake2b
from typing import Final

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.ids import LONGEST, Ids
from minerva_bus.grammar.symbols import AgentKind

MAX_UNUSED: Final = 100
"""Consecutive births without a newborn after which `parents_of` stops comparing hashed ids."""


def check_births(kind: AgentKind) -> None:
    """Check that a kind counts its births, on which ids depend. Raises MisuseError."""
    if not any(field.name == "births" and field.type.kind == "int" for field in kind.fields.all):
        raise MisuseError(
            f"{kind.name} gives birth: declare `births: int = 0` in its class, so that its"
            " children's ids can be told apart"
        )


def child_id(parent: str, births: int) -> str:
    """The id of the child of a birth; hashed if it is too long."""
    return _derived(parent, f"{births}", "")


def parents_of(newborns: Iterable[str], parents: Mapping[str, int]) -> dict[str, str]:
    """The parents of newborns by id; ids that do not derive from any of `parents` are left out.

    `parents` has the number of births of each possible parent before these newborns. A parent need
    not exist any longer.
    """
    lineage, hashed = dict[str, str](), set[str]()
    for newborn in newborns:
        parent, _, _ = newborn.rpartition(":")
        # First, because the text before a hash is the id of an ancestor, which may exist, too.
        if _HASHED_CHILD.search(newborn):
            hashed.add(newborn)
        elif parent in parents:
            lineage[newborn] = parent
    # A hash does not contain the parent's id, so the ids of the next births are compared. Their
    # numbers may have gaps, because a parent need not place each child beside itself.
    birth, unused = 1, 0
    while hashed and unused < MAX_UNUSED:
        ids = {child_id(parent, births + birth): parent for parent, births in parents.items()}
        born = hashed & ids.keys()
        lineage |= {newborn: ids[newborn] for newborn in born}
        hashed -= born
        birth, unused = birth + 1, 0 if born else unused + 1
    return lineage


def copy_id(original: str, frame: int, number: int, height: int = 1) -> str:
    """The id of a copy that a frame makes of an agent; `number` starts at 2.

    `height` is 1 for the agent to which λ is applied. For agents in its scope it is the number of
    nested agents from the copied one inwards, so that copies of an agent differ from those that
    are made with each agent around it.
    """
    mark = f"{frame}-{number}" if height == 1 else f"{frame}-{number}-{height}"
    return _derived(original, mark, f"{frame}")


def newest_copy(ids: Iterable[str]) -> int:
    """The last frame that has made copies with any of these ids; -1 if there are none."""
    return max((int(frame) for agent_id in ids for frame in _COPY.findall(agent_id)), default=-1)


_HASHED_CHILD: Final = re.compile(r":-[0-9a-f]{24}$")
# Hashed ids of copies keep the frame in front of the hash, so that `newest_copy` finds it there.
_COPY: Final = re.compile(r":([0-9]{1,18})-(?:[0-9]+(?:-[0-9]+)?|[0-9a-f]{24})(?=:|$)")


def _derived(source: str, mark: str, before_hash: str) -> str:
    name = f"{source}:{mark}"
    if len(name) <= LONGEST:
        return name
    # 96 bits: a collision would give two agents the same id.
    lineage = blake2b(name.encode(), digest_size=12).hexdigest()
    return f"{source[:16].split(':')[0]}:{before_hash}-{lineage}"


def child_ids(parents: Ids, births: NDArray[np.int64]) -> Ids:
    """The ids of one birth of each parent, equal to `child_id` of each."""
    # 20 bytes hold every 64-bit integer.
    names = np.strings.add(np.strings.add(parents.spelled, b":"), births.astype("S20"))
    longest = int(np.strings.str_len(names).max())
    if longest <= LONGEST:
        return Ids(None, names.astype(f"S{longest}")).sound_like((parents,))
    texts = [child_id(*pair) for pair in zip(parents.texts(), births.tolist(), strict=True)]
    return Ids.of(texts).sound_like((parents,))
