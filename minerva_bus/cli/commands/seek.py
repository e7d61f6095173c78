"""`minerva seek`."""

from __future__ import annotations

from typing import Annotated

import typer

from minerva_bus.cli.options import (
    Connect,
    Keys,
    World,
)

EXAMPLES = (
    "minerva seek 120",
    "minerva seek 0 --world robot",
)


def command(
    frame: Annotated[int, typer.Argument(help="The frame to continue with.", min=0)],
    world: World = "",
    connect: Connect = "",
    keys: Keys = "",
) -> None:
    """Continue a replay at another frame."""
    from minerva_bus.cli.replaying import seek_frame

    seek_frame(frame, connect, world)
