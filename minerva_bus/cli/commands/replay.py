"""`minerva replay`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from minerva_bus.cli.options import (
    Force,
    Json,
    Quiet,
    Takes,
    grouped,
)
from minerva_bus.cli.startup import BEGAN, uncollected
from minerva_bus.cli.words import options_of
from minerva_bus.settings.overrides import Overrides

Record = Annotated[Path, typer.Argument(help="A record, .mcap.")]

EXAMPLES = (
    "minerva replay run.mcap --view sprites --from 100",
    "minerva replay run.mcap --recompute",
)


@grouped
def command(
    context: typer.Context,
    overrides: Annotated[
        Overrides, Takes("view", "name", "listen", "connect", "keys", "insecure", "audit")
    ],
    file: Record,
    world: Annotated[
        str, typer.Argument(help="World file or installed world, if the original one has moved.")
    ] = "",
    begin: Annotated[int, typer.Option("--from", help="Start at this frame.")] = 0,
    speed: Annotated[
        float,
        typer.Option(help="Speed factor: 1: real time; 2: twice as fast; 0: as fast as possible."),
    ] = 1.0,
    recompute: Annotated[
        bool, typer.Option("--recompute", help="Run the agents again and compare each frame.")
    ] = False,
    swap: Annotated[
        str, typer.Option(help="MEMBER=SPEC: run the world again with this member replaced.")
    ] = "",
    record: Annotated[str, typer.Option(help="Record the run of --swap, .mcap.")] = "",
    no_code: Annotated[
        bool, typer.Option("--no-code", help="Run no code: print the frames of the record.")
    ] = False,
    json: Json = False,
    quiet: Quiet = False,
    force: Force = False,
) -> None:
    """Replay a record to any view.

    The commands pause, step, rate and seek work as in a world. This runs the Python code of the
    world file that the record names. For a record from an untrusted source use --no-code, which
    prints the events, agents and digest of each frame (--json: also its string); info, diff and
    plot run no code either.

    --recompute shows nothing; its exit code is 0 if all frames are the same, otherwise 1. So is
    that of --swap, which runs in simulated time: the agents and the new member run again, all
    other members repeat what was recorded. Other options are passed to the new member.
    """
    with uncollected():
        from minerva_bus.cli.recording import show_frames
        from minerva_bus.cli.replaying import recompute_record, replay_record, replay_with
        from minerva_bus.launch.swapping import Swap

    if no_code:
        given = {
            "--swap": swap,
            "--recompute": recompute,
            "--view": overrides.views,
            "WORLD": world,
        }
        for option in [one for one, value in given.items() if value]:
            context.fail(f"{option} runs code, which --no-code forbids; minerva plot runs none")
        show_frames(file, begin, json)
        return
    words = context.args
    if world.startswith("--"):
        words, world = [world, *words], ""
    played = {"--view": bool(overrides.views), "--from": begin != 0, "--speed": speed != 1.0}
    for option in [name for name, given in played.items() if given and (swap or recompute)]:
        context.fail(f"{option} cannot be combined with --{'swap' if swap else 'recompute'}")
    if swap and recompute:
        context.fail("--swap and --recompute exclude each other")
    if swap:
        raise typer.Exit(replay_with(file, world, Swap.read(swap, options_of(words)), record, json))
    if words or record:
        context.fail(f"{words[0] if words else '--record'} requires --swap")
    if recompute:
        raise typer.Exit(recompute_record(file, world, json))
    code = replay_record(
        file, world, overrides, BEGAN, begin=begin, speed=speed, json_too=json, quiet=quiet
    )
    raise typer.Exit(code)
