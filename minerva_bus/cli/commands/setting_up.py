"""`minerva version`."""

from __future__ import annotations

from typing import Final

from minerva_bus.cli.options import Json, examples

TOPIC: Final = "Set up"


@examples(
    "minerva version",
    "minerva version --json",
)
def version(json: Json = False) -> None:
    """Show the versions of Minerva Bus, protocol and dependencies."""
    from minerva_bus.cli.list_and_echo import show_version

    show_version(json)
