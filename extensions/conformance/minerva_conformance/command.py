"""`minerva conformance` with its options; what it does is imported when it is called."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final

import typer

from minerva_bus.cli.options import Force, Json, by_comma, examples

TOPIC: Final = "Develop"


@examples(
    "minerva conformance -- node member.js",
    "minerva conformance --role host --case view --junit host.xml -- ./host",
    "minerva conformance --list",
)
def conformance(
    command: Annotated[
        list[str] | None,
        typer.Argument(help="The program and its arguments, after `--`.", show_default=False),
    ] = None,
    role: Annotated[
        list[str] | None,
        typer.Option(
            help="Roles to check, separated by commas: generator, host, observer, coupled."
            " Default: those that the member declares. Or `coordinator`, alone.",
        ),
    ] = None,
    case: Annotated[
        list[str] | None,
        typer.Option(
            help="Cases, or groups such as `tick`, separated by commas.",
        ),
    ] = None,
    jobs: Annotated[int, typer.Option(help="Cases that run at the same time.", min=1)] = 4,
    list_: Annotated[bool, typer.Option("--list", help="List the cases and exit.")] = False,
    junit: Annotated[Path | None, typer.Option(help="Also write JUnit XML to this file.")] = None,
    json: Json = False,
    force: Force = False,
) -> None:
    """Check whether a member in any language follows the protocol.

    The program is started for each case, with MINERVA_WORLD, MINERVA_CONNECT, MINERVA_NAME and,
    with --role, MINERVA_ROLE set. It behaves as "Write a member in another language" describes.
    With --role coordinator, the program is a coordinator, and the suite plays its members: it has
    MINERVA_WORLD and MINERVA_LISTEN. The exit code is 1 if a case fails.
    """
    from minerva_conformance.score_card_output import check_conformance, list_cases

    if list_:
        list_cases(by_comma(case), by_comma(role), json)
        return
    raise typer.Exit(
        check_conformance(command or [], by_comma(role), by_comma(case), jobs, junit, json)
    )
