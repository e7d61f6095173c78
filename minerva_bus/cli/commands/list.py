"""`minerva list`."""

from __future__ import annotations

from typing import Annotated

import typer

from minerva_bus.cli.options import Connect, Json, Keys, World, chosen

Named = Annotated[str, typer.Argument(metavar="[WORLD]", help="As --world.")]


def command(
    name: Named = "", connect: Connect = "", keys: Keys = "", world: World = "", json: Json = False
) -> None:
    """List the members of a running world; if several run, list the worlds."""
    from minerva_bus.cli.asking import list_members

    list_members(connect, chosen(name, world), json)
