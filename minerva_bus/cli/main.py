"""`minerva`: run worlds, attach to them, ask them, check files."""

from __future__ import annotations

import gc
import os
import sys
import time
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from minerva_bus.errors import MinervaError


def _process_began() -> float:
    """When this process was started, on the monotonic clock; now, where the system won't say."""
    try:
        ticks = int(Path("/proc/self/stat").read_text().rpartition(")")[2].split()[19])
        age = time.clock_gettime(time.CLOCK_BOOTTIME) - ticks / os.sysconf("SC_CLK_TCK")
    except (OSError, ValueError, AttributeError, IndexError):
        age = 0.0
    return time.monotonic() - age


BEGAN = _process_began()
FAILED, WRONG, INTERRUPTED = 1, 2, 130

app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    help="Virtual worlds as strings of a grammar, run by many processes on Zenoh.",
    epilog="Exit codes: 0 done, 1 a check or a world failed, 2 wrong input, 130 interrupted.",
)

_UNKNOWN_TOO = {"allow_extra_args": True, "ignore_unknown_options": True}

Connect = Annotated[
    str, typer.Option(help="Endpoint of the world, such as tcp/HOST:PORT; default: this machine.")
]
World = Annotated[str, typer.Option(help="Name of the world, where there are several.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON on standard output.")]


@app.command(context_settings=_UNKNOWN_TOO)
def run(
    context: typer.Context,
    world: Annotated[str, typer.Argument(help="A world file, or an installed world's name.")] = "",
    seed: Annotated[int | None, typer.Option(help="Seed of all chance.")] = None,
    rate: Annotated[
        float | None, typer.Option(help="Frames per second; 0: as fast as it goes.")
    ] = None,
    frames: Annotated[int | None, typer.Option(help="End after so many frames; 0: never.")] = None,
    view: Annotated[
        list[str] | None,
        typer.Option(help="Add a view: svg, or svg:path=FILE,every=N; may be repeated."),
    ] = None,
    set_: Annotated[
        list[str] | None, typer.Option("--set", help="PROCESS.KEY=VALUE of a process.")
    ] = None,
    name: Annotated[str, typer.Option(help="Run under another name.")] = "",
    until: Annotated[
        str | None, typer.Option(help="End when every agent has sent this event; '': never.")
    ] = None,
    record_video: Annotated[
        str, typer.Option(help="Make a film of it, .mp4 or .gif, frame by frame.")
    ] = "",
    record: Annotated[str, typer.Option(help="Record the run in this file, .mcap.")] = "",
    resume: Annotated[
        Path | None, typer.Option(help="Go on where this record ends; WORLD may be left out.")
    ] = None,
    listen: Annotated[str, typer.Option(help="Where to listen, such as tcp/0.0.0.0:7447.")] = "",
    in_process: Annotated[bool, typer.Option(help="All in one process, without a bus.")] = False,
    json: Json = False,
    quiet: Annotated[bool, typer.Option(help="Say only what goes wrong.")] = False,
    profile: Annotated[
        bool, typer.Option("--profile", help="Show at the end where the time of a frame goes.")
    ] = False,
    profile_member: Annotated[
        str, typer.Option(help="Sample this member's code; a page WORLD-MEMBER.html shows it.")
    ] = "",
) -> None:
    """Run a world. A world's own options, as its [options] say, are options here too.

    The world `robot` has --map FILE.yaml, --objective NAME, --planner random|astar, --robots N
    and more.
    """
    with _uncollected():
        from minerva_bus.cli.running import read_world, run_world
        from minerva_bus.launch.profiling import Profiling
        from minerva_bus.launch.resuming import read_resumed
        from minerva_bus.launch.worldfile import Overrides

        words = context.args
        if world.startswith("--"):
            words, world = [world, *words], ""
        if not world and resume is None:
            context.fail("run what? Name a world file, an installed world or --resume FILE")
        overrides = Overrides(
            options=_options(words),
            settings=tuple(set_ or ()),
            views=_with_video(view or [], record_video),
            until=until,
            record=record,
            name=name,
            seed=seed,
            rate=rate,
            frames=frames,
            listen=listen,
        )
        file = (
            read_world(world, overrides)
            if resume is None
            else read_resumed(resume, world, overrides)
        )
    run_world(
        file,
        BEGAN,
        in_process=in_process,
        json_too=json,
        quiet=quiet,
        profiling=Profiling(profile, profile_member),
    )


def _with_video(views: list[str], video: str) -> tuple[str, ...]:
    """The views that are wanted, one of which makes the film: sprites, if none is named."""
    if not video:
        return tuple(views)
    if "," in video:
        raise MinervaError(f"--record-video {video}: a name without commas, please")
    films = [i for i, one in enumerate(views) if one.partition(":")[0] in ("sprites", "opengl")]
    if not films:
        return (*views, f"sprites:video={video}")
    filmed = views[films[0]]
    views[films[0]] = f"{filmed}{',' if ':' in filmed else ':'}video={video}"
    return tuple(views)


@contextmanager
def _uncollected() -> Generator[None]:
    """Leave garbage lying while all is imported and read: of that, next to nothing is any."""
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()


def _options(words: list[str]) -> dict[str, str]:
    """`--name value` and `--name=value` pairs that typer does not know."""
    found: dict[str, str] = {}
    rest = list(words)
    while rest:
        word = rest.pop(0)
        name, equals, value = word.removeprefix("--").partition("=")
        if not word.startswith("--") or not name:
            raise MinervaError(f"what is {word!r}? Expected options such as --name value")
        if not equals:
            if not rest:
                raise MinervaError(f"--{name} needs a value")
            value = rest.pop(0)
        found[name.replace("-", "_")] = value
    return found


@app.command()
def check(
    file: Annotated[Path, typer.Argument(help="A string (.mnv) or a world (.toml).")],
    vocabulary: Annotated[
        str, typer.Option(help="module:attribute: check symbols and types too.")
    ] = "",
    json: Json = False,
) -> None:
    """Check a string or a world file: exit code 0, or 1 with what is wrong and where."""
    from minerva_bus.cli.checking import check_file

    raise typer.Exit(check_file(file, vocabulary, json))


@app.command(context_settings=_UNKNOWN_TOO)
def attach(
    context: typer.Context,
    spec: Annotated[str, typer.Argument(help="A service's name, or module:Class.")],
    connect: Connect = "",
    world: World = "",
    name: Annotated[str, typer.Option(help="The new member's name; default: made up.")] = "",
) -> None:
    """Add agents, a generator or a view to a running world, from here, until Ctrl-C.

    Options that are unknown here go to the service: `attach svg --every 5`.
    """
    from minerva_bus.cli.attaching import attach_member

    raise typer.Exit(attach_member(spec, connect, world, name, _options(context.args)))


@app.command(context_settings=_UNKNOWN_TOO)
def bridge(
    context: typer.Context,
    kind: Annotated[str, typer.Argument(help="A bridge's name: carmen, rosbag, rplidar, mqtt ...")],
    source: Annotated[str, typer.Argument(help="Its file, device, address or topic.")] = "",
    connect: Connect = "",
    world: World = "",
    name: Annotated[str, typer.Option(help="The new member's name; default: made up.")] = "",
) -> None:
    """Bring real or recorded sensors into a running world, from here, until Ctrl-C.

    Options that are unknown here go to the bridge: `bridge carmen LOG --speed 4`.
    """
    from minerva_bus.cli.attaching import bridge_source

    words = context.args
    if source.startswith("--"):
        words, source = [source, *words], ""
    raise typer.Exit(bridge_source(kind, source, connect, world, name, _options(words)))


@app.command("list")
def list_(connect: Connect = "", world: World = "", json: Json = False) -> None:
    """Show who takes part in a running world; several worlds: show the worlds."""
    from minerva_bus.cli.asking import list_members

    list_members(connect, world, json)


@app.command()
def echo(
    type: Annotated[str, typer.Argument(help="An event type, an agent kind; nothing: all.")] = "",
    connect: Connect = "",
    world: World = "",
    count: Annotated[int, typer.Option(help="End after so many; 0: never.")] = 0,
    json: Json = False,
) -> None:
    """Watch a world's events, its agents' fragments, or a view, by type."""
    from minerva_bus.cli.asking import echo_type

    echo_type(type, connect, world, count, json)


@app.command()
def pub(
    type: Annotated[str, typer.Argument(help="The event's type, such as eObjective.")],
    data: Annotated[list[str] | None, typer.Argument(help="Its data: KEY=VALUE ...")] = None,
    to: Annotated[list[str] | None, typer.Option(help="An agent's id; may be repeated.")] = None,
    condition: Annotated[str, typer.Option("--if", help="Such as 'energy < 5'.")] = "",
    connect: Connect = "",
    world: World = "",
    json: Json = False,
) -> None:
    """Send an event into a running world."""
    from minerva_bus.cli.asking import publish

    publish(type, data or [], to or [], condition, connect, world, json)


@app.command()
def stop(
    world: Annotated[str, typer.Argument(help="Name of the world; default: the only one.")] = "",
    connect: Connect = "",
) -> None:
    """End a running world."""
    from minerva_bus.cli.asking import stop_world

    stop_world(connect, world)


@app.command()
def pause(
    world: Annotated[str, typer.Argument(help="Name of the world; default: the only one.")] = "",
    connect: Connect = "",
) -> None:
    """Let a running world rest between two frames."""
    from minerva_bus.cli.operating import pause_world

    pause_world(connect, world)


@app.command()
def resume(
    world: Annotated[str, typer.Argument(help="Name of the world; default: the only one.")] = "",
    connect: Connect = "",
) -> None:
    """Let a paused world go on."""
    from minerva_bus.cli.operating import resume_world

    resume_world(connect, world)


@app.command()
def step(
    frames: Annotated[int, typer.Argument(help="How many frames.", min=1)] = 1,
    world: World = "",
    connect: Connect = "",
) -> None:
    """Run some frames of a world, and pause it."""
    from minerva_bus.cli.operating import step_world

    step_world(frames, connect, world)


@app.command()
def rate(
    hz: Annotated[float, typer.Argument(help="Frames per second; 0: as fast as it goes.")],
    world: World = "",
    connect: Connect = "",
) -> None:
    """Change how fast a running world goes."""
    from minerva_bus.cli.operating import set_rate

    set_rate(hz, connect, world)


@app.command()
def restart(
    member: Annotated[str, typer.Argument(help="A process of the world file.")],
    world: World = "",
    connect: Connect = "",
) -> None:
    """Start one process of a running world anew."""
    from minerva_bus.cli.operating import restart_member

    restart_member(member, connect, world)


@app.command()
def drain(
    member: Annotated[str, typer.Argument(help="A host of agents.")],
    world: World = "",
    connect: Connect = "",
) -> None:
    """Empty a host of agents, so that it can be stopped: others take over at a frame's edge."""
    from minerva_bus.cli.operating import drain_member

    drain_member(member, connect, world)


@app.command()
def logs(
    member: Annotated[str, typer.Argument(help="Only of this member.")] = "",
    follow: Annotated[bool, typer.Option("--follow", "-f", help="Go on with what comes.")] = False,
    connect: Connect = "",
    world: World = "",
    json: Json = False,
) -> None:
    """Show what the members of a running world have printed, and what was said of them."""
    from minerva_bus.cli.operating import show_logs

    show_logs(member, follow, connect, world, json)


@app.command()
def top(
    connect: Connect = "",
    world: World = "",
    json: Annotated[bool, typer.Option("--json", help="Print one status as JSON.")] = False,
) -> None:
    """Watch a running world in the terminal; pause it, step, restart a member."""
    from minerva_bus.cli.topping import watch_world

    watch_world(connect, world, json)


@app.command()
def info(
    file: Annotated[Path, typer.Argument(help="A record, .mcap.")],
    check: Annotated[bool, typer.Option("--check", help="Compare all digests.")] = False,
    json: Json = False,
) -> None:
    """Show what is in the record of a run."""
    from minerva_bus.cli.recording import show_info

    show_info(file, check, json)


@app.command()
def replay(
    file: Annotated[Path, typer.Argument(help="A record, .mcap.")],
    world: Annotated[
        str, typer.Argument(help="Its world file, or an installed world, if it has moved.")
    ] = "",
    view: Annotated[
        list[str] | None,
        typer.Option(help="Add a view: svg, or svg:path=FILE,every=N; may be repeated."),
    ] = None,
    begin: Annotated[int, typer.Option("--from", help="Begin with this frame.")] = 0,
    speed: Annotated[
        float, typer.Option(help="1: in real time; 2: twice as fast; 0: as fast as it goes.")
    ] = 1.0,
    name: Annotated[str, typer.Option(help="Run under another name than WORLD-replay.")] = "",
    listen: Annotated[str, typer.Option(help="Where to listen, such as tcp/0.0.0.0:7447.")] = "",
    recompute: Annotated[
        bool, typer.Option("--recompute", help="Run the agents again: is each frame the same?")
    ] = False,
    json: Json = False,
    quiet: Annotated[bool, typer.Option(help="Say only what goes wrong.")] = False,
) -> None:
    """Play a record again, into any view; pause, step, rate and seek work as for a world.

    With --recompute nothing is shown: exit code 0 where all frames come out the same, else 1.
    """
    with _uncollected():
        from minerva_bus.cli.replaying import recompute_record, replay_record
        from minerva_bus.launch.worldfile import Overrides

    if recompute:
        raise typer.Exit(recompute_record(file, world, json))
    overrides = Overrides(views=tuple(view or ()), name=name, listen=listen)
    code = replay_record(
        file, world, overrides, BEGAN, begin=begin, speed=speed, json_too=json, quiet=quiet
    )
    raise typer.Exit(code)


@app.command()
def seek(
    frame: Annotated[int, typer.Argument(help="The frame to go on with.", min=0)],
    world: World = "",
    connect: Connect = "",
) -> None:
    """Let a replay go on from another frame."""
    from minerva_bus.cli.replaying import seek_frame

    seek_frame(frame, connect, world)


@app.command()
def diff(
    a: Annotated[Path, typer.Argument(help="A record, .mcap.")],
    b: Annotated[Path, typer.Argument(help="Another one.")],
    json: Json = False,
) -> None:
    """Show the first frame in which two runs differ: exit code 0, or 1 where they do."""
    from minerva_bus.cli.recording import show_difference

    raise typer.Exit(show_difference(a, b, json))


@app.command()
def plot(
    file: Annotated[Path, typer.Argument(help="A record, .mcap.")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="A .png, .svg or .pdf.")
    ] = None,
) -> None:
    """Draw where the agents of a run have been, and how its frames went."""
    from minerva_bus.cli.recording import draw_plot

    draw_plot(file, output)


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
) -> None:
    """Draw the map of a recording, as a robot would have it: .pgm and .yaml, and a picture."""
    from minerva_bus.cli.mapping import map_recording

    map_recording(file, output, cell, range_, from_, to)


@app.command()
def new(
    kind: Annotated[str, typer.Argument(help="What: bridge.")],
    name: Annotated[str, typer.Argument(help="Its name, as of a Python package.")],
    folder: Annotated[Path, typer.Option("--in", help="Where; default: here.")] = Path(),
) -> None:
    """Write the beginnings of a package of your own: a bridge, its tests, a small world."""
    from minerva_bus.cli.making import make_new

    make_new(kind, name, folder)


@app.command()
def doctor(json: Json = False) -> None:
    """Look whether this machine has what worlds need: exit code 0, or 1 with what is missing."""
    from minerva_bus.cli.doctoring import examine

    raise typer.Exit(examine(json))


@app.command()
def version(json: Json = False) -> None:
    """Show the versions of Minerva Bus, its protocol and what it stands on."""
    from minerva_bus.cli.asking import show_version

    show_version(json)


def main() -> None:
    """Run the command line; errors are one message and an exit code, never a traceback."""
    try:
        app()
    except MinervaError as error:
        print(f"minerva: {error}", file=sys.stderr)  # noqa: T201
        sys.exit(WRONG)
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
    except BrokenPipeError:
        sys.exit(0)


if __name__ == "__main__":
    main()
