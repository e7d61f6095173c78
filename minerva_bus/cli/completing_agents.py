"""Completion of the agents of a record and their attributes."""

from __future__ import annotations

from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Final

import typer

from minerva_bus.cli.completing import Choices, completer, paths

if TYPE_CHECKING:
    from minerva_bus.log.reader import Record

MAX_AGENTS: Final = 200


@completer
def records_and_worlds(ctx: typer.Context, incomplete: str) -> Choices:
    """Records, and the worlds that run on this machine."""
    from minerva_bus.launch.registry import running

    yield from ((world.world, world.endpoint) for world in running())
    yield from paths(incomplete, ".mcap")


@completer
def agents(ctx: typer.Context, incomplete: str) -> Choices:
    """Ids of the agents in the last string of the record."""
    from minerva_bus.grammar.scene import agents as agents_of

    with _record(ctx) as record:
        matching = (a for a in agents_of(record.last()[1]) if a.id.startswith(incomplete))
        return [(agent.id, agent.symbol) for agent in islice(matching, MAX_AGENTS)]


@completer
def attributes(ctx: typer.Context, incomplete: str) -> Choices:
    """Attributes of the agent with their types; without an agent, those of all kinds."""
    from minerva_bus.log.past_frames import agent_in

    with _record(ctx) as record:
        name, kinds = str(ctx.params.get("agent") or ""), record.description.world.vocabulary.kinds
        agent = agent_in(record.last()[1], name) if name else None
        fields = [
            field for symbol, kind in sorted(kinds.items())
            if agent is None or agent.symbol == symbol
            for field in kind.fields.all
        ]  # fmt: skip
        return sorted({field.name: str(field.type) for field in fields}.items())


def _record(ctx: typer.Context) -> Record:
    from minerva_bus.log.reader import Record

    # The parser stops at an option that lacks its value, which is the one to complete.
    words = [str(ctx.params.get("record") or ""), *ctx.args]
    return Record(Path(next(word for word in words if word.endswith(".mcap"))))
