"""Completion of what a record or a running world has: agents, their attributes, members."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from minerva_bus.cli.completing import Choices, completer, paths, running
from minerva_bus.files import ending_of

if TYPE_CHECKING:
    from minerva_bus.frame.world_state import WorldSpec
    from minerva_bus.grammar.vocabulary import Vocabulary


@completer
def records_and_running(ctx: typer.Context, incomplete: str) -> Choices:
    """Records, and the worlds that run on this machine."""
    return [*running(ctx, incomplete), *paths(incomplete, ".mcap")]


@completer
def agents(ctx: typer.Context, incomplete: str) -> Choices:
    """The agents at the beginning of a record."""
    return _kinds_of_agents(_recorded(_source(ctx))).items()


@completer
def attributes(ctx: typer.Context, incomplete: str) -> Choices:
    """The attributes of --agent in a record; otherwise, or in a running world, of all agents."""
    source, agent = _source(ctx), str(ctx.params.get("agent") or "")
    if ending_of(source) == ".mcap":
        world = _recorded(source)
        kinds, kind = world.vocabulary.kinds, _kinds_of_agents(world).get(agent)
    else:
        kinds, kind = _vocabulary(source).kinds, None
    chosen = kinds.values() if kind is None else [kinds[kind]]
    return sorted(
        {field.name: str(field.type) for each in chosen for field in each.fields.all}.items()
    )


@completer
def members(ctx: typer.Context, incomplete: str) -> Choices:
    """The members of a record, with the "=" that `minerva swap` expects after one."""
    return [(f"{name}=", "") for name in sorted(_recorded(_source(ctx)).expected)]


def _source(ctx: typer.Context) -> str:
    """The first argument of a command: a record, or a running world."""
    given = ctx.params.get("record") if ctx.command.name == "explain" else ctx.params.get("file")
    # The parser stops at an option that lacks its value, which is the one to complete.
    return str(given or next((word for word in ctx.args if not word.startswith("-")), ""))


def _recorded(path: str) -> WorldSpec:
    from minerva_bus.log.record import Record

    with Record(Path(path)) as record:
        return record.description.world


def _kinds_of_agents(world: WorldSpec) -> dict[str, str]:
    from minerva_bus.grammar.scene import agents as agents_of

    return {agent.id: agent.symbol for agent in agents_of(world.scene)}


def _vocabulary(world: str) -> Vocabulary:
    from minerva_bus.cli.options import WorldTarget
    from minerva_bus.cli.places import client

    with client(WorldTarget(world=world)) as connected:
        return connected.vocabulary()
