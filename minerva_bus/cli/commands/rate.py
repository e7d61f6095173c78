"""`minerva rate`."""

from __future__ import annotations

from typing import Annotated

import typer

from minerva_bus.cli.options import Connect, Keys, World

EXAMPLES = (
    "minerva rate 20",
    "minerva rate 0 --world robot",
)


def command(
    hz: Annotated[float, typer.Argument(help="Frames per second; 0: as fast as possible.")],
    world: World = "",
    connect: Connect = "",
    keys: Keys = "",
) -> None:
    """Change the frame rate of a running world."""
    from minerva_bus.cli.operating import set_rate

    set_rate(hz, connect, world)
