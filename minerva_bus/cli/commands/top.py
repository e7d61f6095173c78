"""`minerva top`."""

from __future__ import annotations

from typing import Annotated

import typer

from minerva_bus.cli.options import Connect, Keys, World, chosen

Named = Annotated[str, typer.Argument(metavar="[WORLD]", help="As --world.")]

EXAMPLES = (
    "minerva top",
    "minerva top robot --json",
)


def command(
    name: Named = "",
    connect: Connect = "",
    keys: Keys = "",
    world: World = "",
    json: Annotated[bool, typer.Option("--json", help="Print the status once, as JSON.")] = False,
) -> None:
    """Monitor and control a running world in the terminal."""
    from minerva_bus.cli.topping import watch_world

    watch_world(connect, chosen(name, world), json)
