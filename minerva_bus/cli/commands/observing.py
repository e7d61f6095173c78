"""Commands that query a running world, or serve what it shows."""

from __future__ import annotations

from typing import Annotated, Final

import typer

from minerva_bus.cli import completing
from minerva_bus.cli.options import Json, NamedTarget, examples, grouped

TOPIC: Final = "Observe"


@examples("minerva list", "minerva list robot --json")
@grouped
def list_(json: Json = False, *, target: NamedTarget) -> None:
    """List the members of a running world, or all worlds.

    If several worlds run, name one to list its members.
    """
    from minerva_bus.cli.list_and_echo import list_members

    list_members(target, json)


@examples("minerva echo eLaser --count 10", "minerva echo robot ARobot --json")
@grouped
def echo(
    type: Annotated[
        str,
        typer.Argument(
            help="An event type or an agent kind; default: all.",
            autocompletion=completing.event_types_and_kinds,
        ),
    ] = "",
    count: Annotated[int, typer.Option(help="Stop after this many; 0: no limit.")] = 0,
    json: Json = False,
    *,
    target: NamedTarget,
) -> None:
    """Print events, agents or views of a running world, by type."""
    from minerva_bus.cli.list_and_echo import echo_type

    echo_type(type, target, count, json)


@examples("minerva logs --follow", "minerva logs robot physics --json")
@grouped
def logs(
    member: Annotated[
        str, typer.Argument(help="Show only this member.", autocompletion=completing.members)
    ] = "",
    follow: Annotated[bool, typer.Option("--follow", "-f", help="Wait for new lines.")] = False,
    json: Json = False,
    *,
    target: NamedTarget,
) -> None:
    """Show the logs of a running world's members."""
    from minerva_bus.cli.operation import show_logs

    show_logs(member, follow, target, json)
