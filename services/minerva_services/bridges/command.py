"""`minerva bridge`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final

import typer

from minerva_bus.cli import completing
from minerva_bus.cli.options import JoinOptions, examples, grouped, options_of

TOPIC: Final = "Run"


@completing.completer
def bridges(ctx: typer.Context, incomplete: str) -> completing.Choices:
    """Services that connect sensors: all that are not views, physics or input of this package."""
    from minerva_bus.entry_points import entries
    from minerva_bus.launch.installed import SERVICES

    others = ("minerva_services.views.", "minerva_services.physics.", "minerva_services.input.")
    return [
        (name, entry.value)
        for name, entry in sorted(entries(SERVICES).items())
        if not entry.value.startswith(others)
    ]


@examples(
    "minerva bridge rplidar /dev/ttyUSB0",
    "minerva bridge carmen run.log --world robot",
)
@grouped
def bridge(
    context: typer.Context,
    kind: Annotated[
        str,
        typer.Argument(
            help="Name of a bridge: carmen, rosbag, rplidar, mqtt ...",
            autocompletion=bridges,
        ),
    ],
    join: JoinOptions,
    source: Annotated[str, typer.Argument(help="Its file, device, address or topic.")] = "",
) -> None:
    """Connect real or recorded sensors to a running world.

    It stays until Ctrl-C. Other options are passed to the bridge, such as
    `bridge carmen LOG --speed 4`; `minerva bridge NAME --help` lists them.
    """
    words = context.args
    # As in `run`: an unknown option may be in place of SOURCE.
    if source.startswith("--"):
        words, source = [source, *words], ""
    raise typer.Exit(bridge_source(kind, source, join, options_of(words)))


def bridge_source(kind: str, source: str, join: JoinOptions, options: dict[str, str]) -> int:
    """Connect a source to a running world until either ends, or Ctrl-C; returns the exit code."""
    from minerva_bus.cli.attaching import attach_member
    from minerva_bus.errors import WorldFileError
    from minerva_bus.launch.specs import find_service

    option = getattr(find_service(kind, Path.cwd()), "source_option", "")
    if source and not option:
        raise WorldFileError(f"{kind} takes no source; see its options")
    if source:
        path = Path(source)  # Not resolved: a link to a device may have another target later.
        options = {**options, option: str(path.absolute()) if path.exists() else source}
    if robot := options.get("robot"):
        _check_agent(join, robot)
    return attach_member(kind, join, options)


def _check_agent(join: JoinOptions, agent: str) -> None:
    """Raise MisuseError if the world has no such agent; one that does not answer yet may have."""
    from minerva_bus.cli.places import identity, place
    from minerva_bus.errors import BusError, MisuseError
    from minerva_bus.runtime.operator_client import Client

    own = identity(join.name) if join.connect else None
    try:
        with Client(*place(join, own), own) as world:
            world.operator.fragment(agent)
    except BusError as error:
        if str(error).startswith("there is no agent"):
            raise MisuseError(f"--robot {agent}: {error}") from None
