"""`minerva echo`."""

from __future__ import annotations

from typing import Annotated

import typer

from minerva_bus.cli.options import Connect, Json, Keys, World

EXAMPLES = (
    "minerva echo eLaser --count 10",
    "minerva echo ARobot --json",
)


def command(
    type: Annotated[str, typer.Argument(help="An event type or an agent kind; default: all.")] = "",
    connect: Connect = "",
    keys: Keys = "",
    world: World = "",
    count: Annotated[int, typer.Option(help="Stop after this many; 0: no limit.")] = 0,
    json: Json = False,
) -> None:
    """Print events, agents or views of a running world, by type."""
    from minerva_bus.cli.asking import echo_type

    echo_type(type, connect, world, count, json)
