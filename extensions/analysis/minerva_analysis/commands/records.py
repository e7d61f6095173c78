"""`minerva replay`, `seek`, `info`, `diff`, `plot`, `swap` and `recover`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Final

import typer

from minerva_analysis.commands import completing as contents
from minerva_bus import process_life
from minerva_bus.cli import completing
from minerva_bus.cli.options import (
    Collect,
    Force,
    Json,
    MovedWorld,
    NamedTarget,
    QuietRun,
    Record,
    Takes,
    examples,
    grouped,
    options_of,
)
from minerva_bus.errors import MisuseError
from minerva_bus.process_life import uncollected
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
        from minerva_analysis.replay_command import recompute_record, replay_record, show_frames

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
        file,
        world,
        overrides,
        process_life.BEGAN,
        begin=begin,
        speed=speed,
        as_json=json,
        quiet=quiet,
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
    from minerva_bus.cli.operation import print_done
    from minerva_bus.cli.places import client

    with client(target) as world:
        world.ask("seek", frame=frame)
        print_done(world, json, f"continues from frame {frame}", frame=frame)


@examples(
    "minerva info run.mcap --check",
    "minerva info run.mcap --frame 40 --string",
)
def info(
    file: Record,
    check: Annotated[
        bool, typer.Option("--check", help="Recompute and compare all digests.")
    ] = False,
    frame: Annotated[
        int | None, typer.Option(help="Show this frame: its initial string and its events.")
    ] = None,
    string: Annotated[
        bool, typer.Option("--string", help="Print the string of --frame, or the last one.")
    ] = False,
    json: Json = False,
) -> None:
    """Show the contents of a record, or one of its frames.

    The exit code of --check is 1 if a digest is wrong, or not all frames could be checked.
    """
    from minerva_analysis.info_command import show_info, show_moment

    if string or frame is not None:
        show_moment(file, frame, string, json)
    else:
        raise typer.Exit(show_info(file, check, json))


@examples(
    "minerva recover run.mcap",
    "minerva recover run.mcap --output intact.mcap",
)
def recover(
    file: Record,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="The new record; default: NAME.recovered.mcap."),
    ] = None,
    json: Json = False,
    force: Force = False,
) -> None:
    """Copy the intact frames of a damaged record to a new one.

    It reports what is lost; the exit code is 1 if anything is damaged. A run that is killed while
    it collects data leaves the folder FILE.parts, from which it makes the tables.
    """
    from minerva_analysis.info_command import recover_record

    raise typer.Exit(recover_record(file, output, json))


@examples(
    "minerva diff run.mcap other.mcap",
    "minerva diff run.mcap other.mcap --json",
)
def diff(
    a: Record,
    b: Annotated[Path, typer.Argument(help="Another record.", autocompletion=completing.records)],
    json: Json = False,
) -> None:
    """Show the first frame in which two runs differ.

    The exit code is 1 if there is one.
    """
    from minerva_analysis.records import diff as compared
    from minerva_bus.cli.output import print_answer

    difference = compared(a, b)
    print_answer(difference, json)
    raise typer.Exit(0 if difference.same else 1)


@examples(
    "minerva bisect run.mcap",
    "minerva bisect before.mcap after.mcap --world-a old/pond.toml --world-b new/pond.toml",
)
def bisect(
    a: Record,
    b: Annotated[
        Path | None,
        typer.Argument(
            help="Another record; default: today's code, run again on the inputs of A.",
            autocompletion=completing.records,
        ),
    ] = None,
    world_a: Annotated[
        str, typer.Option(help="World file with the code of A; default: the one of its record.")
    ] = "",
    world_b: Annotated[str, typer.Option(help="World file with the code of B.")] = "",
    json: Json = False,
) -> None:
    """Show which method or member makes two runs differ first.

    Their first different frame is computed again from its recorded inputs, with the code of each
    side; of two revisions of the code it also shows the functions that differ. The exit code is 1
    if the runs differ. This runs the Python code of the world files.
    """
    from minerva_analysis.bisection import bisect as search
    from minerva_bus.cli.output import FAILED, print_answer, print_message
    from minerva_bus.errors import WorldStopped
    from minerva_bus.launch.console import progress_bar

    try:
        with progress_bar("recompute") as report:
            parting = search(a, b, world_a=world_a, world_b=world_b, progress=report)
    except WorldStopped as stopped:
        print_message(f"minerva: {stopped}")
        raise typer.Exit(FAILED) from stopped
    print_answer(parting, json)
    raise typer.Exit(0 if parting.difference.same else FAILED)


@examples(
    "minerva plot run.mcap --output run.pdf",
    "minerva plot run.mcap --collect 'mean(APerson.days)' --collect 'count(APerson)'",
    "minerva plot sir.parquet --series sick,immune",
)
def plot(
    file: Annotated[Path, typer.Argument(help="A record, .mcap, or a table, .parquet or .csv.")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="A .png, .svg or .pdf.")
    ] = None,
    collect: Collect = None,
    series: Annotated[
        str, typer.Option(help="Columns to plot, separated by commas; default: all.")
    ] = "",
    x: Annotated[str, typer.Option(help="Column along the axis; default: time or frame.")] = "",
    bars: Annotated[
        bool, typer.Option("--bars", help="Histograms of the last frame, not over time.")
    ] = False,
    json: Json = False,
    force: Force = False,
) -> None:
    """Plot trajectories of a run, or collected series.

    Of a table, and of a record with --collect, it plots series and histograms over time: the mean
    over seeds or agents, with a band for the middle 80 % of them.
    """
    from minerva_analysis.plot_command import plot_file

    plot_file(file, output, tuple(collect or ()), series, x, bars=bars, as_json=json)


@examples(
    "minerva swap run.mcap robots=planners:Careful --record careful.mcap",
    "minerva swap run.mcap weather=storms:Storm --wind 20",
)
def swap(
    context: typer.Context,
    file: Record,
    member: Annotated[
        str,
        typer.Argument(
            metavar="MEMBER=SPEC",
            help="A process, and what takes its place.",
            autocompletion=contents.members,
        ),
    ],
    world: MovedWorld = "",
    record: Annotated[str, typer.Option(help="Record this run, .mcap.")] = "",
    json: Json = False,
    force: Force = False,
) -> None:
    """Run a recorded world again with one member replaced.

    The agents and the new member run again, in simulated time; all other members repeat what was
    recorded. The exit code is 0 if all frames are the same, otherwise 1. Other options are passed
    to the new member. This runs the Python code of the world file that the record names.
    """
    from minerva_analysis.swapping import Swap, replay_swapped
    from minerva_bus.cli.output import FAILED, print_answer, print_message
    from minerva_bus.errors import WorldStopped
    from minerva_bus.launch.console import progress_bar

    words = context.args
    # The parser takes unknown options for arguments, so the first may be in place of WORLD.
    if world.startswith("--"):
        words, world = [world, *words], ""
    wanted = Swap.read(member, options_of(words))
    try:
        with progress_bar("recompute") as report:
            result = replay_swapped(
                file, wanted.member, wanted.spec, world,
                options=wanted.options, into=record, progress=report,
            )  # fmt: skip
    except WorldStopped as stopped:
        print_message(f"minerva: {stopped}")
        raise typer.Exit(FAILED) from stopped
    print_answer(result, json)
    raise typer.Exit(0 if result.difference.same else FAILED)
