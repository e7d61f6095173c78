"""`minerva recover`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from minerva_bus.cli.options import (
    Force,
    Json,
)

Record = Annotated[Path, typer.Argument(help="A record, .mcap.")]

EXAMPLES = (
    "minerva recover run.mcap",
    "minerva recover run.mcap --output intact.mcap",
)


def command(
    file: Record,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="The new record; default: NAME.recovered.mcap."),
    ] = None,
    json: Json = False,
    force: Force = False,
) -> None:
    """Copy the intact frames of a damaged record to a new one.

    It reports what is lost.
    """
    from minerva_bus.cli.recording import recover_record

    recover_record(file, output, json)
