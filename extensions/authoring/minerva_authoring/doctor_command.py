"""`minerva doctor`."""

from __future__ import annotations

from typing import Final

import typer

from minerva_bus.cli.options import Json, examples

TOPIC: Final = "Set up"


@examples(
    "minerva doctor",
    "minerva doctor --json",
)
def doctor(json: Json = False) -> None:
    """Check the environment and report missing dependencies.

    The exit code is 1 if there are any.
    """
    from minerva_authoring.doctor import examine

    raise typer.Exit(examine(json))
