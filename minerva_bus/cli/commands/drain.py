"""`minerva drain`."""

from __future__ import annotations

from typing import Annotated

import typer

from minerva_bus.cli.options import Connect, Keys, World

EXAMPLES = (
    "minerva drain hosts-1",
    "minerva drain hosts-1 --world robot",
)


def command(
    member: Annotated[str, typer.Argument(help="A host of agents.")],
    world: World = "",
    connect: Connect = "",
    keys: Keys = "",
) -> None:
    """Move all agents of a host to other hosts.

    The host can then be stopped without a pause of the world.
    """
    from minerva_bus.cli.operating import drain_member

    drain_member(member, connect, world)
