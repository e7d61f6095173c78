"""`minerva doctor` and `minerva version`."""

from __future__ import annotations

from typing import Any, Final

import typer

from minerva_bus.cli.options import Json, examples, options_of

TOPIC: Final = "Set up"


@examples(
    "minerva doctor",
    "minerva doctor --json",
    "minerva doctor --ros2 tcp/192.168.1.20:7447",
    "minerva doctor --ros2 tcp/192.168.1.20:7447/scan",
    "minerva doctor --ros2 ros2",
)
def doctor(context: typer.Context, json: Json = False) -> None:
    """Check the environment and report missing dependencies.

    Other checks may be installed: `--ros2 ENDPOINT` lists the nodes and topics of a ROS 2 robot,
    `--ros2 ENDPOINT/TOPIC` shows what a topic carries, and `--ros2 WORLD` reports what of the robot
    does not fit the world. The exit code is 1 if anything is missing or does not fit.
    """
    from minerva_authoring.doctor import examine

    raise typer.Exit(examine(json, options_of(context.args)))


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
