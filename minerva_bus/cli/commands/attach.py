"""`minerva attach`."""

from __future__ import annotations

from typing import Annotated

import typer

from minerva_bus.cli.options import (
    Connect,
    Force,
    KeepTrying,
    Keys,
    World,
)
from minerva_bus.cli.words import options_of

EXAMPLES = (
    "minerva attach svg --path now.svg",
    "minerva attach garden:Snail --connect tls/host:7447 --keys keys --name hostA",
)


def command(
    context: typer.Context,
    spec: Annotated[str, typer.Argument(help="A service's name, or module:Class.")],
    connect: Connect = "",
    keys: Keys = "",
    world: World = "",
    name: Annotated[
        str,
        typer.Option(
            help="Name of the new member; default: that of its certificate, or a generated one."
        ),
    ] = "",
    process: Annotated[
        str, typer.Option(help="Run this process of the world file SPEC, under its name.")
    ] = "",
    keep_trying: KeepTrying = None,
    force: Force = False,
) -> None:
    """Attach agents, a generator or a view to a running world.

    It stays until Ctrl-C. Other options are passed to the service: `attach svg --every 5`. With
    --process they are options of the world: `attach robot --process physics --map house.yaml`.
    """
    from minerva_bus.cli.attaching import ConnectOptions, attach_member

    way, options = ConnectOptions(connect, world, keep_trying), options_of(context.args)
    raise typer.Exit(attach_member(spec, way, name, options, process))
