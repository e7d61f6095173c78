"""What a service has saved of each agent, as one text: so many plain values would be too many."""

from __future__ import annotations

from collections.abc import Mapping

AGENTS = "agents"
"""The name of this text in the saved data of a service."""


def agent_lines(texts: Mapping[str, str]) -> str:
    """What a service has saved of each agent, one line each, sorted by id. Inverse: `by_agent`."""
    return "\n".join([f"{who}\t{text}" for who, text in sorted(texts.items())])


def by_agent(lines: str) -> dict[str, str]:
    """What a service has saved of each agent, by id. Raises ValueError for other texts."""
    pairs = [line.partition("\t") for line in lines.split("\n")] if lines else []
    if not all(who and tab for who, tab, _ in pairs):
        raise ValueError("a line without an id and a tab")
    return {who: text for who, _, text in pairs}
