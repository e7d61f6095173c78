"""What was recorded: `minerva info`, `recover`, `replay`, `seek`, `diff`, `plot`, `map`, ..."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from minerva_bus.cli.options import (
    UNKNOWN_TOO,
    Connect,
    Force,
    Json,
    Keys,
    Quiet,
    Takes,
    World,
    grouped,
)
from minerva_bus.cli.startup import BEGAN, uncollected
from minerva_bus.cli.words import options_of
from minerva_bus.settings.overrides import Overrides

app = typer.Typer()

Record = Annotated[Path, typer.Argument(help="A record, .mcap.")]


@app.command()
def info(
    file: Record,
    check: Annotated[bool, typer.Option("--check", help="Compare all digests.")] = False,
    frame: Annotated[
        int | None, typer.Option(help="Show this frame: what it begins with, and its events.")
    ] = None,
    string: Annotated[
        bool, typer.Option("--string", help="Print the string of --frame, or of the end.")
    ] = False,
    json: Json = False,
) -> None:
    """Show what is in the record of a run, or one frame of it."""
    from minerva_bus.cli.recording import show_info, show_moment

    if string or frame is not None:
        show_moment(file, frame, string, json)
    else:
        show_info(file, check, json)


@app.command()
def recover(
    file: Record,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="The new record; default: NAME.recovered.mcap."),
    ] = None,
    json: Json = False,
    force: Force = False,
) -> None:
    """Write all that is intact in a damaged or cut record into a new one, and say what is lost."""
    from minerva_bus.cli.recording import recover_record

    recover_record(file, output, json)


@app.command(context_settings=UNKNOWN_TOO)
@grouped
def replay(
    context: typer.Context,
    overrides: Annotated[
        Overrides, Takes("view", "name", "listen", "connect", "keys", "insecure", "audit")
    ],
    file: Record,
    world: Annotated[
        str, typer.Argument(help="Its world file, or an installed world, if it has moved.")
    ] = "",
    begin: Annotated[int, typer.Option("--from", help="Begin with this frame.")] = 0,
    speed: Annotated[
        float, typer.Option(help="1: in real time; 2: twice as fast; 0: as fast as it goes.")
    ] = 1.0,
    recompute: Annotated[
        bool, typer.Option("--recompute", help="Run the agents again: is each frame the same?")
    ] = False,
    swap: Annotated[
        str, typer.Option(help="MEMBER=SPEC: run it again with another member in its place.")
    ] = "",
    record: Annotated[str, typer.Option(help="With --swap: record that run, .mcap.")] = "",
    no_code: Annotated[
        bool, typer.Option("--no-code", help="Run no code: print the frames of the record.")
    ] = False,
    json: Json = False,
    quiet: Quiet = False,
    force: Force = False,
) -> None:
    """Play a record again, into any view; pause, step, rate and seek work as for a world.

    This runs the Python code of the world file that the record names. Of people whom you do not
    trust, look at a record with --no-code, which prints each frame's events, agents and digest
    (--json: its string, too); info, diff and plot run no code either.

    With --recompute nothing is shown: exit code 0 where all frames come out the same, else 1. So
    it is with --swap, in simulated time: agents run again, the new member says what it says, and
    all others what was recorded. Options that are unknown here are the new member's.
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
            context.fail(f"{option} needs code: not with --no-code; minerva plot draws without")
        show_frames(file, begin, json)
        return
    words = context.args
    if world.startswith("--"):
        words, world = [world, *words], ""
    played = {"--view": bool(overrides.views), "--from": begin != 0, "--speed": speed != 1.0}
    for option in [name for name, given in played.items() if given and (swap or recompute)]:
        context.fail(f"{option} is for playing, not for --{'swap' if swap else 'recompute'}")
    if swap and recompute:
        context.fail("--swap and --recompute are two things: ask for one of them")
    if swap:
        raise typer.Exit(replay_with(file, world, Swap.read(swap, options_of(words)), record, json))
    if words or record:
        context.fail(f"{words[0] if words else '--record'} goes with --swap")
    if recompute:
        raise typer.Exit(recompute_record(file, world, json))
    code = replay_record(
        file, world, overrides, BEGAN, begin=begin, speed=speed, json_too=json, quiet=quiet
    )
    raise typer.Exit(code)


@app.command()
def seek(
    frame: Annotated[int, typer.Argument(help="The frame to go on with.", min=0)],
    world: World = "",
    connect: Connect = "",
    keys: Keys = "",
) -> None:
    """Let a replay go on from another frame."""
    from minerva_bus.cli.replaying import seek_frame

    seek_frame(frame, connect, world)


@app.command()
def diff(
    a: Record,
    b: Annotated[Path, typer.Argument(help="Another one.")],
    json: Json = False,
) -> None:
    """Show the first frame in which two runs differ: exit code 0, or 1 where they do."""
    from minerva_bus.cli.recording import show_difference

    raise typer.Exit(show_difference(a, b, json))


@app.command()
def plot(
    file: Record,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="A .png, .svg or .pdf.")
    ] = None,
    force: Force = False,
) -> None:
    """Draw where the agents of a run have been, and how its frames went."""
    from minerva_bus.cli.recording import draw_plot

    draw_plot(file, output)


@app.command()
def conversation(
    file: Record,
    conversation: Annotated[
        str, typer.Option(help="Only what was said in the conversation of this id.")
    ] = "",
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="A .svg, or a .mmd for Mermaid.")
    ] = None,
    json: Json = False,
    force: Force = False,
) -> None:
    """Show which messages agents have sent one another, as a sequence diagram (Mermaid)."""
    from minerva_bus.cli.conversing import show_conversation

    show_conversation(file, conversation, output, json)


@app.command("map")
def map_(
    file: Annotated[Path, typer.Argument(help="A CARMEN log or a bag: .log, .bag, .db3, .mcap.")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="The .pgm; default: named after FILE.")
    ] = None,
    cell: Annotated[float, typer.Option(help="Metres, the side of a cell.")] = 0.05,
    range_: Annotated[
        float, typer.Option("--range", help="Metres; farther hits do not count; 0: as recorded.")
    ] = 0.0,
    from_: Annotated[float, typer.Option("--from", help="Seconds after the beginning.")] = 0.0,
    to: Annotated[float | None, typer.Option(help="Seconds after the beginning.")] = None,
    poses: Annotated[
        str, typer.Option(help="Where the robot was: published, odometry or matched.")
    ] = "published",
    time_offset: Annotated[
        float,
        typer.Option(help="Seconds added to the times of scans: the lidar's clock may differ."),
    ] = 0.0,
    force: Force = False,
) -> None:
    """Draw the map of a recording, as a robot would have it: .pgm and .yaml, and a picture."""
    from minerva_bus.cli.mapping import map_recording

    map_recording(file, output, cell, range_, from_, to, poses, time_offset)
