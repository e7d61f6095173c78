"""`minerva doctor`."""

from __future__ import annotations

import typer

from minerva_bus.cli.options import Json

EXAMPLES = (
    "minerva doctor",
    "minerva doctor --json",
)


def command(json: Json = False) -> None:
    """Check the environment and report missing dependencies.

    The exit code is 1 if there are any.
    """
    from minerva_bus.cli.doctoring import examine

    raise typer.Exit(examine(json))
