"""The end of a world in regions, which is decided from what all of them report."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from minerva_bus.frame.composition import Composition
from minerva_bus.frame.description import World
from minerva_bus.frame.goal import WorldGoal
from minerva_bus.frame.live import why_over


@dataclass(frozen=True, slots=True)
class Progress:
    """What a region's frame means for the end of the world.

    `resting`: its next frame would change nothing. `reached`: its agents that have sent `until` in
    this frame. `given_up`: those that have sent `give_up`, and not `until` since, with the event as
    text. `striving`: the kinds of both.
    """

    resting: bool
    reached: frozenset[str]
    given_up: Mapping[str, str]
    striving: frozenset[str]


NO_PROGRESS: Final = Progress(False, frozenset(), {}, frozenset())


class RegionsGoal:
    """Decides when a world is over whose regions are in this process."""

    def __init__(self, world: World, parts: Sequence[Composition]) -> None:
        """`parts` are the strings of all regions."""
        self._world, self._parts = world, parts
        self._goal = WorldGoal(world, parts[0], {})

    def learn(self, progress: Iterable[Progress]) -> None:
        """Note a frame of all regions."""
        for each in progress:
            self._goal.learn(each.reached, each.striving, each.given_up)

    def why_over(self, frame: int) -> str:
        """Reason why a frame does not begin, or an empty string."""
        empty = all(part.empty for part in self._parts)
        return why_over(self._world, frame, empty, self._goal.finished_in(self._parts))

    @property
    def reached(self) -> bool:
        """Whether every agent of the kinds that send `until` has sent it."""
        return bool(self._goal.finished_in(self._parts)) and not self._goal.given_up
