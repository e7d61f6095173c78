"""What services with a halo save in regions: texts of agents, which move with them, and numbers.

A region has the texts of its agents, and numbers of its own. Together they are what a service of
one coordinator saves.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

from minerva_bus.errors import ProtocolError, WorldStopped
from minerva_bus.frame import messages as m
from minerva_bus.grammar.scene import agents
from minerva_bus.regions.merging import Units
from minerva_bus.world.halo import AGENTS, agent_lines, by_agent


def check_saved(service: str, saved: m.Saved) -> None:
    """Raise WorldStopped if a service with a halo has saved data of another form."""
    numbers = {name: value for name, value in (saved or {}).items() if name != AGENTS}
    texts = (saved or {}).get(AGENTS, "")
    if isinstance(texts, str) and all(type(each) in (int, float) for each in numbers.values()):
        return
    raise WorldStopped(
        f"regions: halo = true: {service} saves {', '.join(sorted(saved or {}))[:80]}; expected the"
        ' texts of agents as "agents", and numbers (see Halo), or halo = false'
    )


def texts_of(saved: m.Saved) -> dict[str, str]:
    """What a service has saved of agents, by id. Raises ProtocolError for other data."""
    texts = (saved or {}).get(AGENTS, "")
    try:
        return by_agent(texts if isinstance(texts, str) else "?")
    except ValueError:
        raise ProtocolError("a service with a halo has saved no lines of agents") from None


def with_texts(saved: m.Saved, texts: Mapping[str, str]) -> dict[str, Any]:
    """The same saved data, with these texts of agents."""
    return {**(saved or {}), AGENTS: agent_lines(texts)}


def own_parts(
    saved: Mapping[str, m.Saved], services: Iterable[str], own: Units, number: int
) -> dict[str, Any]:
    """Saved data of a world, for services only those of a region's own agents.

    The numbers of all regions are the first one's.
    """
    names = [name for name in services if AGENTS in (saved.get(name) or {})]
    present = {agent.id for agent in agents(own.scene)} if names else set[str]()
    parts: dict[str, Any] = {}
    for name in names:
        texts = {who: text for who, text in texts_of(saved[name]).items() if who in present}
        numbers = saved[name] if number == 0 else dict.fromkeys(saved[name] or (), 0)
        parts[name] = with_texts(numbers, texts)
    return {**saved, **parts}


def parted(
    saved: m.Saved, left: Collection[str], moving: Mapping[str, int]
) -> tuple[m.Saved, dict[int, dict[str, str]]]:
    """Saved data without agents that have left, and the texts of those that move, by region."""
    if saved is None or not left:
        return saved, {}
    texts, away = texts_of(saved), dict[int, dict[str, str]]()
    for who in texts.keys() & moving.keys():
        away.setdefault(moving[who], {})[who] = texts[who]
    stay = {who: text for who, text in texts.items() if who not in left}
    return (with_texts(saved, stay) if AGENTS in saved else saved), away


def kept_by(saved: Mapping[str, m.Saved], services: Iterable[str]) -> dict[str, str]:
    """The lines that these services have saved of agents, by the name of the service."""
    parts = {name: saved.get(name) or {} for name in services}
    return {name: part[AGENTS] for name, part in sorted(parts.items()) if part.get(AGENTS)}


def joined_parts(parts: Sequence[m.Saved]) -> m.Saved:
    """What all regions have saved, as one coordinator's service has; None if none has."""
    present = [part for part in parts if part is not None]
    if not present:
        return None
    texts: dict[str, str] = {}
    joined: dict[str, Any] = {}
    for part in present:
        texts |= texts_of(part)
        for name, value in part.items():
            joined[name] = value if name == AGENTS else joined.get(name, 0) + value
    return with_texts(joined, texts) if AGENTS in joined else joined


def checked_texts(value: object) -> str:
    """Texts of agents from another region. Raises ProtocolError for other data."""
    texts_of({AGENTS: value})
    assert isinstance(value, str)
    return value
