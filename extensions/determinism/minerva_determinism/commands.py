"""`minerva determinism` and `minerva certify`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final

import typer

from minerva_bus.cli import completing
from minerva_bus.cli.options import Force, Json, WorldArgument, examples

TOPIC: Final = "Develop"
MINUTES: Final = 10.0
FRAMES: Final = 100
FRAMES_OF_ALL: Final = 20
"""The frames of each run of all installed worlds, which end within `MINUTES` on two cores."""


@examples(
    "minerva determinism garden.toml",
    "minerva determinism meadow --frames 20 --json",
)
def determinism(
    world: WorldArgument,
    frames: Annotated[int, typer.Option(min=1, help="Most frames to compare.")] = 100,
    json: Json = False,
) -> None:
    """Run a world in two process layouts and compare all frames.

    The exit code is 1 with the first frame, agent and attribute that differ. The world is recorded
    in both runs, which needs the extra `record`.
    """
    from minerva_determinism.determinism import check_determinism

    raise typer.Exit(check_determinism(world, frames, json))


@examples(
    "minerva certify garden.toml --report certificate.html",
    "minerva certify meadow --processes 16 --processes 64",
    "minerva certify meadow --python python3.13",
    "minerva certify meadow --emulate aarch64 --setup arm",
)
def certify(
    worlds: Annotated[
        list[str] | None,
        typer.Argument(
            help="World files or installed worlds; default: all installed worlds.",
            autocompletion=completing.installed,
        ),
    ] = None,
    frames: Annotated[
        int | None,
        typer.Option(
            min=1, help=f"Most frames of each run ({FRAMES}; {FRAMES_OF_ALL} if all worlds run)."
        ),
    ] = None,
    minutes: Annotated[
        float, typer.Option(min=0.1, help="Time after which no further check begins.")
    ] = MINUTES,
    processes: Annotated[
        list[int] | None,
        typer.Option(
            min=1,
            help="A further number of processes for each kind of agents of the first world; may be"
            " repeated.",
        ),
    ] = None,
    python: Annotated[
        list[str] | None,
        typer.Option(
            help="Command of another interpreter with Minerva Bus, maybe of another processor; may"
            " be repeated.",
        ),
    ] = None,
    emulate: Annotated[
        str,
        typer.Option(
            metavar="PROCESSOR",
            help="Also run on this processor, which QEMU emulates: aarch64.",
        ),
    ] = "",
    setup: Annotated[
        Path | None,
        typer.Option(
            help="Folder of the Python for this processor; it is made if it is not there, in a few"
            " minutes.",
        ),
    ] = None,
    report: Annotated[
        Path | None, typer.Option(help="Also write the certificate as a page, .html.")
    ] = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Run worlds in all layouts, kill processes, compare frames.

    The exit code is 1 if something differs, fails or has no time left. The worlds are recorded,
    which needs the extra `record`.
    """
    from minerva_determinism.certify_command import interpreters, make_certificate

    pythons = interpreters(python or [], emulate, setup)
    most = frames or (FRAMES if worlds else FRAMES_OF_ALL)
    code = make_certificate(worlds or [], most, minutes, processes or [], pythons, report, json)
    raise typer.Exit(code)
