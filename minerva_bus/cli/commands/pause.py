"""`minerva pause`."""

from __future__ import annotations

from typing import Annotated

import typer

from minerva_bus.cli.options import Connect, Keys, World, chosen

Named = Annotated[str, typer.Argument(metavar="[WORLD]", help="As --world.")]

EXAMPLES = (
    "minerva pause",
    "minerva pause robot",
)


def command(name: Named = "", connect: Connect = "", keys: Keys = "", world: World = "") -> None:
    """Pause a running world."""
    from minerva_bus.cli.operating import pause_world

    pause_world(connect, chosen(name, world))
