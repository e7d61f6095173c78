"""The agents about which a member answers."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Final

from minerva_bus.grammar.scene import Piece


@dataclass(frozen=True, slots=True)
class OwnAgents:
    """The nodes of a string about which a member answers, counted only if its answer is large.

    `places` is how many numbers their places have, in a world with regions.
    """

    pieces: Callable[[], Iterable[Piece]] = tuple
    places: Callable[[], int] = int

    def captured(self) -> OwnAgents:
        """The present nodes, for another thread."""
        pieces = tuple(self.pieces())
        return replace(self, pieces=lambda: pieces)


NO_AGENTS: Final = OwnAgents()
