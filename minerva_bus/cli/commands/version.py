"""`minerva version`."""

from __future__ import annotations

from minerva_bus.cli.options import Json

EXAMPLES = (
    "minerva version",
    "minerva version --json",
)


def command(json: Json = False) -> None:
    """Show the versions of Minerva Bus, protocol and dependencies."""
    from minerva_bus.cli.asking import show_version

    show_version(json)
