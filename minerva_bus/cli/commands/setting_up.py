"""Commands that set up: editors and the installation."""

from __future__ import annotations

import typer

from minerva_bus.cli.options import Json, examples


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


@examples(
    "minerva doctor",
    "minerva doctor --json",
)
def doctor(json: Json = False) -> None:
    """Check the environment and report missing dependencies.

    The exit code is 1 if there are any.
    """
    from minerva_bus.cli.doctoring import examine

    raise typer.Exit(examine(json))


@examples(
    "minerva version",
    "minerva version --json",
)
def version(json: Json = False) -> None:
    """Show the versions of Minerva Bus, protocol and dependencies."""
    from minerva_bus.cli.list_and_echo import show_version

    show_version(json)
