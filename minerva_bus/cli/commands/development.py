"""`minerva new`, `doctor` and `version`: for those who build on it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from minerva_bus.cli.options import Json

app = typer.Typer()


@app.command()
def new(
    kind: Annotated[str, typer.Argument(help="What: bridge.")],
    name: Annotated[str, typer.Argument(help="Its name, as of a Python package.")],
    folder: Annotated[Path, typer.Option("--in", help="Where; default: here.")] = Path(),
) -> None:
    """Write the beginnings of a package of your own: a bridge, its tests, a small world."""
    from minerva_bus.cli.making import make_new

    make_new(kind, name, folder)


@app.command()
def doctor(json: Json = False) -> None:
    """Look whether this machine has what worlds need: exit code 0, or 1 with what is missing."""
    from minerva_bus.cli.doctoring import examine

    raise typer.Exit(examine(json))


@app.command()
def version(json: Json = False) -> None:
    """Show the versions of Minerva Bus, its protocol and what it stands on."""
    from minerva_bus.cli.asking import show_version

    show_version(json)
