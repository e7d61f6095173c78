"""`minerva bridge`."""

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
    "minerva bridge rplidar /dev/ttyUSB0",
    "minerva bridge carmen run.log --world robot",
)


def command(
    context: typer.Context,
    kind: Annotated[
        str, typer.Argument(help="Name of a bridge: carmen, rosbag, rplidar, mqtt ...")
    ],
    source: Annotated[str, typer.Argument(help="Its file, device, address or topic.")] = "",
    connect: Connect = "",
    keys: Keys = "",
    world: World = "",
    name: Annotated[
        str,
        typer.Option(
            help="Name of the new member; default: that of its certificate, or a generated one."
        ),
    ] = "",
    keep_trying: KeepTrying = None,
    force: Force = False,
) -> None:
    """Connect real or recorded sensors to a running world.

    It stays until Ctrl-C. Other options are passed to the bridge, such as
    `bridge carmen LOG --speed 4`; `minerva bridge NAME --help` lists them.
    """
    from minerva_bus.cli.attaching import ConnectOptions, bridge_source

    words = context.args
    if source.startswith("--"):
        words, source = [source, *words], ""
    way = ConnectOptions(connect, world, keep_trying)
    raise typer.Exit(bridge_source(kind, source, way, name, options_of(words)))
