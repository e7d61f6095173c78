"""`minerva new`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

EXAMPLES = (
    "minerva new world my_yard",
    "minerva new bridge wind_meter --in ~/projects",
)


def command(
    kind: Annotated[str, typer.Argument(help="world, agent, service, geometry or bridge.")],
    name: Annotated[str, typer.Argument(help="Its name, a valid name of a Python package.")],
    folder: Annotated[
        Path, typer.Option("--in", help="Parent folder; default: the current one.")
    ] = Path(),
) -> None:
    """Create a world, agent, service, geometry or bridge.

    The new folder runs as it is and contains tests.
    """
    from minerva_bus.cli.making import make_new

    make_new(kind, name, folder)
