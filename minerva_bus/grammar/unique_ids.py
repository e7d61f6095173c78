"""The check that ids of agents are unique in a string, and its messages."""

from __future__ import annotations

from minerva_bus.grammar.fitting import Unfit
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.scene import AGENT_ID


def same_id(agent_id: str) -> str:
    """The message for two agents with the same id."""
    return f"two agents have the id #{agent_id}"


def no_id(text: str) -> str:
    """The message for a text that is not a valid id."""
    return f"{text!r} is not a valid agent id; expected letters, digits, _, : and -"


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
        if agent_id in self._single or any(ids.row_of(agent_id) >= 0 for ids in self._columns):
            raise Unfit(same_id(agent_id))
        self._single.add(agent_id)

    def add_all(self, ids: Ids) -> None:
        """Add the ids of agents in columns. Raises Unfit."""
        if (strange := ids.strange) is not None:
            raise Unfit(no_id(strange))
        known = [*self._columns, *([Ids.of(sorted(self._single))] if self._single else [])]
        if (duplicate := Ids.in_common([ids, *known])) is not None:
            raise Unfit(same_id(duplicate))
        self._columns.append(ids)
