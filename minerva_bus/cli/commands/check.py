"""`minerva check`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from minerva_bus.cli.options import (
    Json,
)
from minerva_bus.errors import MisuseError

EXAMPLES = (
    "minerva check garden.toml --determinism",
    "minerva check scene.mnv --vocabulary garden:vocabulary",
)


def command(
    file: Annotated[Path, typer.Argument(help="A string (.mnv) or a world (.toml).")],
    vocabulary: Annotated[
        str, typer.Option(help="module:attribute: also check symbols and types.")
    ] = "",
    determinism: Annotated[
        bool,
        typer.Option("--determinism", help="Run the world in two process layouts and compare."),
    ] = False,
    frames: Annotated[
        int | None, typer.Option(min=1, help="Number of frames for --determinism; default: 100.")
    ] = None,
    no_code: Annotated[
        bool, typer.Option("--no-code", help="Run no code: check only the grammar and the file.")
    ] = False,
    json: Json = False,
) -> None:
    """Check a string or a world file.

    The exit code is 0, or 1 with the error and its place. This runs the Python code that the
    world file or --vocabulary names. Use --no-code for files from untrusted sources.
    """
    if no_code and (determinism or vocabulary):
        raise MisuseError(f"--{'determinism' if determinism else 'vocabulary'} runs code")
    if frames is not None and not determinism:
        raise MisuseError("--frames requires --determinism: a check runs no frames")
    if determinism:
        from minerva_bus.cli.determining import FRAMES, check_determinism

        raise typer.Exit(check_determinism(str(file), frames or FRAMES, json))
    from minerva_bus.cli.checking import check_file

    raise typer.Exit(check_file(file, vocabulary, json, code=not no_code))
