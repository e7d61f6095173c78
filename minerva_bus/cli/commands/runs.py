"""`minerva run`, `check`, `attach` and `bridge`: worlds and those who take part come to life."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from minerva_bus.cli.options import (
    UNKNOWN_TOO,
    Audit,
    Connect,
    Force,
    Insecure,
    Json,
    KeepTrying,
    Keys,
    Listen,
    Quiet,
    Routers,
    RunKeys,
    Settings,
    Views,
    World,
)
from minerva_bus.cli.startup import BEGAN, uncollected
from minerva_bus.cli.words import options_of
from minerva_bus.errors import MinervaError, MisuseError

app = typer.Typer()


@app.command(context_settings=UNKNOWN_TOO)
def run(
    context: typer.Context,
    world: Annotated[str, typer.Argument(help="A world file, or an installed world's name.")] = "",
    seed: Annotated[int | None, typer.Option(help="Seed of all chance.")] = None,
    rate: Annotated[
        float | None, typer.Option(help="Frames per second; 0: as fast as it goes.")
    ] = None,
    frames: Annotated[int | None, typer.Option(help="End after so many frames; 0: never.")] = None,
    view: Views = None,
    set_: Settings = None,
    name: Annotated[str, typer.Option(help="Run under another name.")] = "",
    until: Annotated[
        str | None, typer.Option(help="End when every agent has sent this event; '': never.")
    ] = None,
    record_video: Annotated[
        str, typer.Option(help="Make a film of it, .mp4 or .gif, frame by frame.")
    ] = "",
    record: Annotated[str, typer.Option(help="Record the run in this file, .mcap.")] = "",
    record_topics: Annotated[
        str, typer.Option(help="Record sensor data, too: all, or topics such as scan,image.")
    ] = "",
    flush: Annotated[
        float | None, typer.Option(help="Seconds after which a record reaches the disk.")
    ] = None,
    durable: Annotated[
        bool, typer.Option("--durable", help="A frame counts once its record is on the disk.")
    ] = False,
    resume: Annotated[
        Path | None, typer.Option(help="Go on where this record ends; WORLD may be left out.")
    ] = None,
    journal: Annotated[
        str, typer.Option(help="Keep the journal in this folder, and go on from one that is there.")
    ] = "",
    listen: Listen = "",
    connect: Routers = None,
    keys: RunKeys = "",
    insecure: Insecure = False,
    audit: Audit = False,
    coordinator_only: Annotated[
        bool, typer.Option(help="Start no members: they are attached from elsewhere.")
    ] = False,
    metrics: Annotated[
        str, typer.Option(help="Serve /metrics, /live and /ready at HOST:PORT.")
    ] = "",
    log_format: Annotated[str, typer.Option(help="How log lines are written: text or json.")] = "",
    in_process: Annotated[bool, typer.Option(help="All in one process, without a bus.")] = False,
    json: Json = False,
    quiet: Quiet = False,
    profile: Annotated[
        bool, typer.Option("--profile", help="Show at the end where the time of a frame goes.")
    ] = False,
    profile_member: Annotated[
        str, typer.Option(help="Sample this member's code; a page WORLD-MEMBER.html shows it.")
    ] = "",
    force: Force = False,
    traceback: Annotated[
        bool, typer.Option("--traceback", help="Show all frames of an error in a member's code.")
    ] = False,
) -> None:
    """Run a world. A world's own options, as its [options] say, are options here too.

    The world `robot` has --map FILE.yaml, --objective NAME, --planner random|astar, --robots N
    and more.
    """
    with uncollected():
        from minerva_bus.cli.running import read_world, run_world
        from minerva_bus.launch.border import BorderOverrides
        from minerva_bus.launch.keeping import RecordOverrides
        from minerva_bus.launch.overrides import Overrides
        from minerva_bus.launch.profiling import Profiling
        from minerva_bus.launch.resuming import read_resumed

        words = context.args
        if world.startswith("--"):
            words, world = [world, *words], ""
        if not world and resume is None:
            context.fail("run what? Name a world file, an installed world or --resume FILE")
        overrides = Overrides(
            options=options_of(words),
            settings=tuple(set_ or ()),
            views=_with_video(view or [], record_video),
            until=until,
            record=record,
            name=name,
            seed=seed,
            rate=rate,
            frames=frames,
            journal=journal,
            listen=listen,
            border=BorderOverrides(tuple(connect or ()), keys, insecure, audit),
            recording=RecordOverrides("", flush, durable or None, record_topics),
            metrics=metrics,
            log_format=log_format,
            coordinator_only=coordinator_only,
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
        traceback=traceback,
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


@app.command()
def check(
    file: Annotated[Path, typer.Argument(help="A string (.mnv) or a world (.toml).")],
    vocabulary: Annotated[
        str, typer.Option(help="module:attribute: check symbols and types too.")
    ] = "",
    determinism: Annotated[
        bool, typer.Option("--determinism", help="Run the world in two layouts, and compare.")
    ] = False,
    frames: Annotated[
        int | None, typer.Option(min=1, help="With --determinism: how many; default: 100.")
    ] = None,
    no_code: Annotated[
        bool, typer.Option("--no-code", help="Run no code: check the grammar and the file alone.")
    ] = False,
    json: Json = False,
) -> None:
    """Check a string or a world file: exit code 0, or 1 with what is wrong and where.

    This runs the Python code that a world file, or --vocabulary, names. Check a file of people whom
    you do not trust with --no-code.
    """
    if no_code and (determinism or vocabulary):
        raise MisuseError(f"--{'determinism' if determinism else 'vocabulary'} runs code")
    if frames is not None and not determinism:
        raise MisuseError("--frames belongs to --determinism: a check alone runs nothing")
    if determinism:
        from minerva_bus.cli.determining import FRAMES, check_determinism

        raise typer.Exit(check_determinism(str(file), frames or FRAMES, json))
    from minerva_bus.cli.checking import check_file

    raise typer.Exit(check_file(file, vocabulary, json, code=not no_code))


@app.command(context_settings=UNKNOWN_TOO)
def attach(
    context: typer.Context,
    spec: Annotated[str, typer.Argument(help="A service's name, or module:Class.")],
    connect: Connect = "",
    keys: Keys = "",
    world: World = "",
    name: Annotated[
        str, typer.Option(help="The new member's name; default: its certificate's, or made up.")
    ] = "",
    process: Annotated[
        str, typer.Option(help="SPEC is a world file: be this process of it, under its name.")
    ] = "",
    keep_trying: KeepTrying = None,
    force: Force = False,
) -> None:
    """Add agents, a generator or a view to a running world, from here, until Ctrl-C.

    Options that are unknown here go to the service: `attach svg --every 5`. With --process they
    are the world's own: `attach robot --process physics --map house.yaml`.
    """
    from minerva_bus.cli.attaching import Way, attach_member

    way, options = Way(connect, world, keep_trying), options_of(context.args)
    raise typer.Exit(attach_member(spec, way, name, options, process))


@app.command(context_settings=UNKNOWN_TOO)
def bridge(
    context: typer.Context,
    kind: Annotated[str, typer.Argument(help="A bridge's name: carmen, rosbag, rplidar, mqtt ...")],
    source: Annotated[str, typer.Argument(help="Its file, device, address or topic.")] = "",
    connect: Connect = "",
    keys: Keys = "",
    world: World = "",
    name: Annotated[
        str, typer.Option(help="The new member's name; default: its certificate's, or made up.")
    ] = "",
    keep_trying: KeepTrying = None,
    force: Force = False,
) -> None:
    """Bring real or recorded sensors into a running world, from here, until Ctrl-C.

    Options that are unknown here go to the bridge: `bridge carmen LOG --speed 4`.
    """
    from minerva_bus.cli.attaching import Way, bridge_source

    words = context.args
    if source.startswith("--"):
        words, source = [source, *words], ""
    way = Way(connect, world, keep_trying)
    raise typer.Exit(bridge_source(kind, source, way, name, options_of(words)))
