"""`minerva step`."""

from __future__ import annotations

from typing import Annotated

import typer

from minerva_bus.cli.options import Connect, Keys, World

EXAMPLES = (
    "minerva step",
    "minerva step 10 --world robot",
)


def command(
    frames: Annotated[int, typer.Argument(help="Number of frames.", min=1)] = 1,
    world: World = "",
    connect: Connect = "",
    keys: Keys = "",
) -> None:
    """Run a number of frames, then pause."""
    from minerva_bus.cli.operating import step_world

    step_world(frames, connect, world)
