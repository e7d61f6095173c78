"""`minerva info`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from minerva_bus.cli.options import (
    Json,
)

Record = Annotated[Path, typer.Argument(help="A record, .mcap.")]

EXAMPLES = (
    "minerva info run.mcap --check",
    "minerva info run.mcap --frame 40 --string",
)


def command(
    file: Record,
    check: Annotated[
        bool, typer.Option("--check", help="Recompute and compare all digests.")
    ] = False,
    frame: Annotated[
        int | None, typer.Option(help="Show this frame: its initial string and its events.")
    ] = None,
    string: Annotated[
        bool, typer.Option("--string", help="Print the string of --frame, or the last one.")
    ] = False,
    json: Json = False,
) -> None:
    """Show the contents of a record, or one of its frames."""
    from minerva_bus.cli.recording import show_info, show_moment

    if string or frame is not None:
        show_moment(file, frame, string, json)
    else:
        show_info(file, check, json)
