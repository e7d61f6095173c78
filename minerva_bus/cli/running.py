"""`minerva run`."""

from __future__ import annotations

import json
import signal
import sys

import typer

from minerva_bus.errors import MisuseError, WorldStopped
from minerva_bus.launch.alone import Alone
from minerva_bus.launch.console import Console
from minerva_bus.launch.profiling import NOTHING, Profiling
from minerva_bus.launch.specs import find_world
from minerva_bus.launch.supervisor import Supervisor
from minerva_bus.launch.worldfile import Overrides, WorldFile, read_world_file

FAILED, INTERRUPTED = 1, 130


def read_world(world: str, overrides: Overrides) -> WorldFile:
    """The world file of a path or an installed name. Raises WorldFileError and SceneError."""
    return read_world_file(find_world(world), overrides)


def run_world(
    file: WorldFile,
    began: float,
    *,
    in_process: bool,
    json_too: bool,
    quiet: bool,
    profiling: Profiling = NOTHING,
) -> None:
    """Run a world and print its summary; exits with 1 where it failed and 130 on Ctrl-C."""
    if in_process and profiling != NOTHING:
        raise MisuseError("--profile and --profile-member look at the bus: not with --in-process")
    profiling.check(file)
    console = Console(quiet=quiet or (json_too and not sys.stderr.isatty()))
    failure = ""
    try:
        if in_process:
            signal.signal(signal.SIGTERM, signal.default_int_handler)
            summary = Alone(file, console, began).run()
        else:
            supervisor = Supervisor(file, console, began, profiling)
            summary = supervisor.run()
            failure = supervisor.failure
    except WorldStopped as stopped:
        print(f"minerva: {file.world.name}: {stopped}", file=sys.stderr)  # noqa: T201
        raise typer.Exit(FAILED) from None
    if json_too:
        print(json.dumps(summary.plain()))  # noqa: T201
    else:
        print("\n".join(summary.lines()))  # noqa: T201
    if summary.ended in ("interrupted", "terminated"):
        raise typer.Exit(INTERRUPTED)
    if failure:
        raise typer.Exit(FAILED)
    sys.stdout.flush()
