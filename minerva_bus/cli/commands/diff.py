"""`minerva diff`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from minerva_bus.cli.options import (
    Json,
)

Record = Annotated[Path, typer.Argument(help="A record, .mcap.")]

EXAMPLES = (
    "minerva diff run.mcap other.mcap",
    "minerva diff run.mcap other.mcap --json",
)


def command(
    a: Record,
    b: Annotated[Path, typer.Argument(help="Another record.")],
    json: Json = False,
) -> None:
    """Show the first frame in which two runs differ.

    The exit code is 1 if there is one.
    """
    from minerva_bus.cli.recording import show_difference

    raise typer.Exit(show_difference(a, b, json))
