"""`minerva pub`."""

from __future__ import annotations

from typing import Annotated

import typer

from minerva_bus.cli.options import Connect, Json, Keys, World

EXAMPLES = (
    "minerva pub eObjective marker=kitchen",
    "minerva pub eSpeed speed=30cm/s --to r1",
)


def command(
    type: Annotated[str, typer.Argument(help="The event's type, such as eObjective.")],
    data: Annotated[
        list[str] | None, typer.Argument(help="Data of the event: KEY=VALUE ...")
    ] = None,
    to: Annotated[
        list[str] | None, typer.Option(help="Id of a receiving agent; may be repeated.")
    ] = None,
    condition: Annotated[
        str, typer.Option("--if", help="Condition of the event, such as 'energy < 5'.")
    ] = "",
    connect: Connect = "",
    keys: Keys = "",
    world: World = "",
    json: Json = False,
) -> None:
    """Send an event into a running world."""
    from minerva_bus.cli.asking import publish

    publish(type, data or [], to or [], condition, connect, world, json)
