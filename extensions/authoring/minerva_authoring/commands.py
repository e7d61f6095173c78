"""`minerva new` and `minerva schema`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final

import typer

from minerva_bus.cli import completing
from minerva_bus.cli.options import Json, examples

TOPIC: Final = "Develop"


@completing.completer
def complete_kinds(ctx: typer.Context, incomplete: str) -> completing.Choices:
    """What `minerva new` can create."""
    from minerva_authoring.scaffold import KINDS

    return [(kind, "") for kind in KINDS]


@examples(
    "minerva new world my_yard",
    "minerva new world my_meadow --from meadow",
)
def new(
    kind: Annotated[
        str,
        typer.Argument(
            help="world, agent, service, geometry or bridge.", autocompletion=complete_kinds
        ),
    ],
    name: Annotated[str, typer.Argument(help="Its name, a valid name of a Python package.")],
    folder: Annotated[
        Path, typer.Option("--in", help="Parent folder; default: the current one.")
    ] = Path(),
    model: Annotated[
        str,
        typer.Option(
            "--from",
            help="Copy this installed world; see `minerva worlds`.",
            autocompletion=completing.installed,
        ),
    ] = "",
    json: Json = False,
) -> None:
    """Create a world, agent, service, geometry or bridge.

    The new folder runs as it is and contains tests.
    """
    from minerva_authoring.scaffold import create

    create(kind, name, folder, model, json)


@examples(
    "minerva schema > world.schema.json",
    "minerva schema > .vscode/world.schema.json",
)
def schema() -> None:
    """Print the JSON Schema of world files, for editors.

    Editors that know TOML validate and complete a world file whose first line is
    `#:schema world.schema.json`.
    """
    import json

    from minerva_authoring.world_schema import world_schema
    from minerva_bus.cli.output import print_result

    print_result(json.dumps(world_schema(), indent=2, ensure_ascii=False))
