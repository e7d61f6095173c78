"""`minerva restart`."""

from __future__ import annotations

from typing import Annotated

import typer

from minerva_bus.cli.options import Connect, Keys, World

EXAMPLES = (
    "minerva restart physics",
    "minerva restart hosts-2 --world robot",
)


def command(
    member: Annotated[str, typer.Argument(help="A process of the world file.")],
    world: World = "",
    connect: Connect = "",
    keys: Keys = "",
) -> None:
    """Restart one process of a running world."""
    from minerva_bus.cli.operating import restart_member

    restart_member(member, connect, world)
