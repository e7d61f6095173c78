"""`minerva logs`."""

from __future__ import annotations

from typing import Annotated

import typer

from minerva_bus.cli.options import Connect, Json, Keys, World

EXAMPLES = (
    "minerva logs --follow",
    "minerva logs physics --json",
)


def command(
    member: Annotated[str, typer.Argument(help="Show only this member.")] = "",
    follow: Annotated[bool, typer.Option("--follow", "-f", help="Wait for new lines.")] = False,
    connect: Connect = "",
    keys: Keys = "",
    world: World = "",
    json: Json = False,
) -> None:
    """Show the logs of a running world's members."""
    from minerva_bus.cli.operating import show_logs

    show_logs(member, follow, connect, world, json)
