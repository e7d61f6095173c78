"""`minerva doctor` and `minerva version`."""

from __future__ import annotations

from typing import Any, Final

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


@examples(
    "minerva version",
    "minerva version --json",
)
def version(json: Json = False) -> None:
    """Show the versions of Minerva Bus, protocol and dependencies."""
    import platform
    from importlib.metadata import version as version_of

    from minerva_bus.cli.output import print_json, print_table
    from minerva_bus.frame.messages import PROTOCOL_VERSION

    versions: dict[str, Any] = {
        "minerva-bus": version_of("minerva-bus"),
        "protocol": PROTOCOL_VERSION,
        "python": platform.python_version(),
    }
    for package in ("eclipse-zenoh", "msgpack", "numpy", "pymunk", "typer"):
        versions[package] = version_of(package)
    if json:
        print_json(versions)
    else:
        rows = [(name, str(value)) for name, value in versions.items()]
        print_table([("part", "version"), *rows])
