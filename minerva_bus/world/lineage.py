"""Ids of newborns and copies: made from another's, so they are the same wherever a world runs.

    a:3        the third child of #a, by the count in its state
    a:7-2      the second copy of #a that frame 7 makes under the literal policy (equation 3)
    a:7-2-3    #a in the second copy of an agent around it, around which agents are nested 3 deep

What follows the last colon says which of these an id is and from which id it comes, so no two
rules, parents, frames or copies give the same id. An id longer than `LONGEST` is hashed.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from hashlib import blake2b
from typing import Final

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.ids import LONGEST, Ids
from minerva_bus.grammar.symbols import AgentKind


def check_births(kind: AgentKind) -> None:
    """Check that a kind counts its births, on which ids depend. Raises MisuseError."""
    if not any(field.name == "births" and field.type.kind == "int" for field in kind.fields.all):
        raise MisuseError(
            f"{kind.name} gives birth: declare `births: int = 0` in its class, so that its"
            " children's ids can be told apart"
        )


def child_id(parent: str, births: int) -> str:
    """The id of a child, unique to this birth; an id that would be too long is hashed."""
    return _derived(parent, f"{births}", "")


def copy_id(original: str, frame: int, number: int, height: int = 1) -> str:
    """The id of a copy that a frame makes of an agent; `number` is from 2, the first keeps the id.

    `height` is 1 for the agent that λ is applied to. For agents in its scope it is how many agents
    stand around one another there, the copied one included: so an agent's own copies differ from
    those that come with the copies of each agent around it.
    """
    mark = f"{frame}-{number}" if height == 1 else f"{frame}-{number}-{height}"
    return _derived(original, mark, f"{frame}")


def newest_copy(ids: Iterable[str]) -> int:
    """The last frame that has made copies with some of these ids; -1 where none has."""
    return max((int(frame) for agent_id in ids for frame in _COPY.findall(agent_id)), default=-1)


_COPY: Final = re.compile(r":([0-9]{1,18})-(?:[0-9]+(?:-[0-9]+)?|[0-9a-f]{24})(?=:|$)")


def _derived(source: str, mark: str, before_hash: str) -> str:
    name = f"{source}:{mark}"
    if len(name) <= LONGEST:
        return name
    lineage = blake2b(name.encode(), digest_size=12).hexdigest()
    return f"{source[:16].split(':')[0]}:{before_hash}-{lineage}"


def child_ids(parents: Ids, births: NDArray[np.int64]) -> Ids:
    """The ids of one birth of each parent; those of `child_id`."""
    names = np.strings.add(np.strings.add(parents.spelled, b":"), births.astype("S20"))
    longest = int(np.strings.str_len(names).max())
    if longest <= LONGEST:
        return Ids(None, names.astype(f"S{longest}")).sound_like((parents,))
    texts = [child_id(*pair) for pair in zip(parents.texts(), births.tolist(), strict=True)]
    return Ids.of(texts).sound_like((parents,))
