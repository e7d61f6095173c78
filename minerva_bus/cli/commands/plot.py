"""`minerva plot`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from minerva_bus.cli.options import (
    Force,
)

Record = Annotated[Path, typer.Argument(help="A record, .mcap.")]

EXAMPLES = (
    "minerva plot run.mcap",
    "minerva plot run.mcap --output run.pdf",
)


def command(
    file: Record,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="A .png, .svg or .pdf.")
    ] = None,
    force: Force = False,
) -> None:
    """Plot trajectories and frame statistics of a run."""
    from minerva_bus.cli.recording import draw_plot

    draw_plot(file, output)
