"""`minerva schema`."""

from __future__ import annotations

EXAMPLES = (
    "minerva schema > world.schema.json",
    "minerva schema > .vscode/world.schema.json",
)


def command() -> None:
    """Print the JSON Schema of world files, for editors.

    Editors that know TOML validate and complete a world file whose first line is
    `#:schema world.schema.json`.
    """
    import json

    from minerva_bus.cli.saying import say
    from minerva_bus.settings.schema import world_schema

    say(json.dumps(world_schema(), indent=2, ensure_ascii=False))
