"""`minerva run`, `check`, `attach` and `bridge`: worlds and those who take part come to life."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from minerva_bus.cli.options import (
    UNKNOWN_TOO,
    Connect,
    Force,
    Json,
    KeepTrying,
    Keys,
    RunOptions,
    Takes,
    World,
    grouped,
)
from minerva_bus.cli.startup import BEGAN, uncollected
from minerva_bus.cli.words import options_of
from minerva_bus.errors import MinervaError, MisuseError
from minerva_bus.settings.overrides import Overrides

app = typer.Typer()


@app.command(context_settings=UNKNOWN_TOO)
@grouped
def run(
    context: typer.Context,
    overrides: Annotated[
        Overrides,
        Takes(
            *("seed", "rate", "frames", "view", "set_", "name", "until"),
            *("record", "record_topics", "flush", "durable", "journal"),
            *("listen", "connect", "keys", "insecure", "audit", "coordinator_only"),
            *("metrics", "log_format"),
        ),
    ],
    options: RunOptions,
    world: Annotated[str, typer.Argument(help="A world file, or an installed world's name.")] = "",
    record_video: Annotated[
        str, typer.Option(help="Write a video of all frames to this file, .mp4 or .gif.")
    ] = "",
    resume: Annotated[
        Path | None, typer.Option(help="Resume at the end of this record; WORLD may be omitted.")
    ] = None,
    force: Force = False,
) -> None:
    """Run a world. The world's own options, declared in its [options], are options here too.

    For example, the world `robot` has --map FILE.yaml, --objective NAME, --planner random|astar
    and --robots N.
    """
    with uncollected():
        from minerva_bus.cli.running import read_world, run_world
        from minerva_bus.launch.resuming import read_resumed

        words = context.args
        if world.startswith("--"):
            words, world = [world, *words], ""
        if not world and resume is None:
            context.fail("run what? Name a world file, an installed world or --resume FILE")
        views = _with_video(list(overrides.views), record_video)
        given = Overrides(options_of(words), overrides.settings, views, **overrides.values)
        file = read_world(world, given) if resume is None else read_resumed(resume, world, given)
    run_world(file, BEGAN, options)


def _with_video(views: list[str], video: str) -> tuple[str, ...]:
    """The requested views, one of which writes the video: sprites unless another one can."""
    if not video:
        return tuple(views)
    if "," in video:
        raise MinervaError(f"--record-video {video}: the file name must not contain a comma")
    for at, view in enumerate(views):
        if view.partition(":")[0] in ("sprites", "opengl"):
            views[at] = f"{view}{',' if ':' in view else ':'}video={video}"
            return tuple(views)
    return (*views, f"sprites:video={video}")


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
