"""`minerva resume`."""

from __future__ import annotations

from typing import Annotated

import typer

from minerva_bus.cli.options import Connect, Keys, World, chosen

Named = Annotated[str, typer.Argument(metavar="[WORLD]", help="As --world.")]

EXAMPLES = (
    "minerva resume",
    "minerva resume robot",
)


def command(name: Named = "", connect: Connect = "", keys: Keys = "", world: World = "") -> None:
    """Resume a paused world."""
    from minerva_bus.cli.operating import resume_world

    resume_world(connect, chosen(name, world))
