"""The agents about which a member answers."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Final

from minerva_bus.grammar.scene import Piece


@dataclass(frozen=True, slots=True)
class OwnAgents:
    """The nodes of a string about which a member answers, counted only if its answer is large."""

    pieces: Callable[[], Iterable[Piece]] = tuple

    def captured(self) -> OwnAgents:
        """The present nodes, for another thread."""
        pieces = tuple(self.pieces())
        return OwnAgents(lambda: pieces)


NO_AGENTS: Final = OwnAgents()
