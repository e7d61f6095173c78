"""The check that ids of agents are unique in a string, and its messages."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from typing import Final

from minerva_bus.grammar.fitting import Unfit
from minerva_bus.grammar.id_search import apart
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.scene import AGENT_ID, Scene, agents


def same_id(agent_id: str) -> str:
    """The message for two agents with the same id."""
    return f"two agents have the id #{agent_id}"


MAX_SHOWN: Final = 64
"""Characters of an invalid id in its message."""


def no_id(text: str) -> str:
    """The message for a text that is not a valid id."""
    shown = text if len(text) <= MAX_SHOWN else f"{text[:MAX_SHOWN]}…"
    return f"{shown!r} is not a valid agent id; expected letters, digits, _, : and -, at most 1024"


def invalid_id(texts: Iterable[str]) -> str | None:
    """The first text that is not a valid id; None if all are."""
    return next((text for text in texts if AGENT_ID.fullmatch(text) is None), None)


def repeated_id(columns: Sequence[Ids], single: Collection[str] = ()) -> str | None:
    """An id that occurs twice in columns, or in columns and among single ids; otherwise None."""
    # Single agents have no columns to compare with, so their ids are collected here.
    every = [*columns, *([Ids.of(sorted(single))] if columns and single else [])]
    repeated = next((ids.duplicate for ids in every if ids.duplicate is not None), None)
    if repeated is not None or len(every) < 2:
        return repeated
    if all(apart(ids, other) for n, ids in enumerate(every) for other in every[:n]):
        return None
    return Ids.concatenated(every).duplicate


def repeated_in(scene: Scene) -> str | None:
    """An id that occurs twice in a string; None if all are different."""
    single = set[str]()
    for piece in scene.pieces:
        for agent in agents(Scene((piece,))) if piece.ids is None else ():
            if agent.id in single:
                return agent.id
            single.add(agent.id)
    return repeated_id([piece.ids for piece in scene.pieces if piece.ids is not None], single)


class UniqueIds:
    """The ids of a string, added one by one or as columns. Raises Unfit for a repeated one."""

    def __init__(self) -> None:
        self._single: set[str] = set()
        self._columns: list[Ids] = []

    def add(self, agent_id: str) -> None:
        """Add the id of one agent. Raises Unfit."""
        if AGENT_ID.fullmatch(agent_id) is None:
            raise Unfit(no_id(agent_id))
        # Columns stay columns: an id is searched in them without creating a text for each agent.
        for ids in self._columns:
            if ids.row_of(agent_id) >= 0:
                raise Unfit(same_id(agent_id))
        if agent_id in self._single:
            raise Unfit(same_id(agent_id))
        self._single.add(agent_id)

    def add_all(self, ids: Ids) -> None:
        """Add the ids of agents in columns. Raises Unfit."""
        if (strange := ids.strange) is not None:
            raise Unfit(no_id(strange))
        if (repeated := repeated_id([ids, *self._columns], self._single)) is not None:
            raise Unfit(same_id(repeated))
        self._columns.append(ids)
