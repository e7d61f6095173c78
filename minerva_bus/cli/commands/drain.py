"""`minerva drain`."""

from __future__ import annotations

from typing import Annotated

import typer

from minerva_bus.cli.options import Connect, Keys, World


def command(
    member: Annotated[str, typer.Argument(help="A host of agents.")],
    world: World = "",
    connect: Connect = "",
    keys: Keys = "",
) -> None:
    """Drain a host so that it can be stopped: its agents move to other hosts."""
    from minerva_bus.cli.operating import drain_member

    drain_member(member, connect, world)
