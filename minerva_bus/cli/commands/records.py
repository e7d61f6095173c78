"""Commands that read records of runs, and recordings of sensors."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Final

import typer

from minerva_bus.cli import startup
from minerva_bus.cli.options import (
    Force,
    Json,
    MovedWorld,
    NamedTarget,
    QuietRun,
    Record,
    Takes,
    examples,
    grouped,
)
from minerva_bus.cli.startup import uncollected
from minerva_bus.errors import MisuseError
from minerva_bus.settings.world_settings import Overrides

TOPIC: Final = "Records"


@examples(
    "minerva replay run.mcap --view sprites --from 100",
    "minerva replay run.mcap --recompute",
)
@grouped
def replay(
    overrides: Annotated[Overrides, Takes("view", "name", "listen", "connect", "keys", "insecure")],
    file: Record,
    world: MovedWorld = "",
    begin: Annotated[int, typer.Option("--from", help="Start at this frame.")] = 0,
    speed: Annotated[
        float,
        typer.Option(help="Speed factor: 1: real time; 2: twice as fast; 0: as fast as possible."),
    ] = 1.0,
    recompute: Annotated[
        bool, typer.Option("--recompute", help="Run the agents again and compare each frame.")
    ] = False,
    no_code: Annotated[
        bool, typer.Option("--no-code", help="Run no code: print the frames of the record.")
    ] = False,
    json: Json = False,
    quiet: QuietRun = False,
    force: Force = False,
) -> None:
    """Replay a record to any view.

    The commands pause, step, rate and seek work as in a world. This runs the Python code of the
    world file that the record names. For a record from an untrusted source use --no-code, which
    prints the events, agents and digest of each frame (--json: also its string); info, diff and
    plot run no code either.

    --recompute shows nothing; its exit code is 0 if all frames are the same, otherwise 1.
    """
    with uncollected():
        from minerva_bus.cli.recording import recompute_record, replay_record, show_frames

    if no_code:
        code = {"--recompute": recompute, "--view": overrides.views, "WORLD": world}
        _refuse(code, "runs code, which --no-code forbids; minerva plot runs none")
        show_frames(file, begin, json)
        return
    if recompute:
        # These would be ignored without a word.
        played = {"--view": overrides.views, "--from": begin != 0, "--speed": speed != 1.0}
        _refuse(played, "cannot be combined with --recompute")
        raise typer.Exit(recompute_record(file, world, json))
    code = replay_record(
        file, world, overrides, startup.BEGAN, begin=begin, speed=speed, as_json=json, quiet=quiet
    )
    raise typer.Exit(code)


def _refuse(options: Mapping[str, object], reason: str) -> None:
    """Raise MisuseError if one of these options is given."""
    for option in [name for name, value in options.items() if value]:
        raise MisuseError(f"{option} {reason}")


@examples(
    "minerva seek 120",
    "minerva seek robot 0",
)
@grouped
def seek(
    frame: Annotated[int, typer.Argument(help="The frame to continue with.", min=0)],
    json: Json = False,
    *,
    target: NamedTarget,
) -> None:
    """Continue a replay at another frame."""
    from minerva_bus.cli.operation import seek_frame

    seek_frame(frame, target, json)
