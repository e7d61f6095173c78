"""`minerva stop`."""

from __future__ import annotations

from typing import Annotated

import typer

from minerva_bus.cli.options import Connect, Keys, World, chosen

Named = Annotated[str, typer.Argument(metavar="[WORLD]", help="As --world.")]

EXAMPLES = (
    "minerva stop",
    "minerva stop robot",
)


def command(name: Named = "", connect: Connect = "", keys: Keys = "", world: World = "") -> None:
    """Stop a running world."""
    from minerva_bus.cli.asking import stop_world

    stop_world(connect, chosen(name, world))
