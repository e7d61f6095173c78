"""`minerva list`."""

from __future__ import annotations

from typing import Annotated

import typer

from minerva_bus.cli.options import Connect, Json, Keys, World, chosen

Named = Annotated[str, typer.Argument(metavar="[WORLD]", help="As --world.")]

EXAMPLES = (
    "minerva list",
    "minerva list robot --json",
)


def command(
    name: Named = "", connect: Connect = "", keys: Keys = "", world: World = "", json: Json = False
) -> None:
    """List the members of a running world, or all worlds.

    If several worlds run, name one to list its members.
    """
    from minerva_bus.cli.asking import list_members

    list_members(connect, chosen(name, world), json)
