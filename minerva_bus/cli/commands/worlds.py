"""Commands that list, run, check and join worlds."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Final

import typer

from minerva_bus import process_life
from minerva_bus.cli import completing
from minerva_bus.cli.options import (
    Force,
    JoinOptions,
    Json,
    RunOptions,
    Takes,
    WorldArgument,
    examples,
    grouped,
    options_of,
)
from minerva_bus.errors import MinervaError, MisuseError, SceneError
from minerva_bus.process_life import uncollected
from minerva_bus.settings.world_settings import Overrides

TOPIC: Final = "Run"


@examples(
    "minerva run robot --view web",
    "minerva run garden.toml --frames 100 --seed 7 --record garden.mcap",
    "minerva run meadow --collect 'foxes=count(AFox)' --into foxes.csv",
)
@grouped
def run(
    context: typer.Context,
    overrides: Annotated[
        Overrides,
        Takes(
            *("seed", "rate", "frames", "view", "set_", "name", "until", "compiled"),
            *("record", "record_topics", "flush", "durable", "journal", "collect", "into"),
            *("listen", "connect", "keys", "insecure", "coordinator_only"),
            *("metrics", "log_format", "processes"),
        ),
    ],
    options: RunOptions,
    world: WorldArgument = "",
    record_video: Annotated[
        str, typer.Option(help="Write a video of all frames to this file, .mp4 or .gif.")
    ] = "",
    resume: Annotated[
        Path | None,
        typer.Option(
            help="Resume at the end of this record; WORLD may be omitted.",
            autocompletion=completing.records,
        ),
    ] = None,
    force: Force = False,
) -> None:
    """Run a world.

    The world's own options, declared in its [options], are options here too: `minerva run WORLD
    --help` lists them.
    """
    with uncollected():
        from minerva_bus.cli.run_choice import read_world, run_world
        from minerva_bus.launch.past import read_resumed

        words = context.args
        # The parser takes unknown options for arguments, so the first may be in place of WORLD.
        if world.startswith("--"):
            words, world = [world, *words], ""
        if not world and resume is None:
            raise MisuseError("run: no world: name one (minerva worlds), a file or --resume FILE")
        views = _with_video(list(overrides.views), record_video)
        given = Overrides(
            options_of(words), overrides.settings, views, overrides.collect, **overrides.values
        )
        file = read_world(world, given) if resume is None else read_resumed(resume, world, given)
    run_world(file, process_life.BEGAN, options)


def _with_video(views: list[str], video: str) -> tuple[str, ...]:
    """The requested views, one of which writes the video: sprites unless another one can."""
    if not video:
        return tuple(views)
    # A comma separates the options of a view.
    if "," in video:
        raise MinervaError(f"--record-video {video}: the file name must not contain a comma")
    for at, view in enumerate(views):
        if view.partition(":")[0] in ("sprites", "opengl"):
            views[at] = f"{view}{',' if ':' in view else ':'}video={video}"
            return tuple(views)
    return (*views, f"sprites:video={video}")


@examples(
    "minerva check garden.toml --no-code", "minerva check scene.mnv --vocabulary garden:vocabulary"
)
def check(
    file: Annotated[
        Path,
        typer.Argument(
            help="A string (.mnv) or a world (.toml).", autocompletion=completing.strings_and_worlds
        ),
    ],
    vocabulary: Annotated[
        str, typer.Option(help="module:attribute: also check symbols and types.")
    ] = "",
    no_code: Annotated[
        bool, typer.Option("--no-code", help="Run no code: check only the grammar and the file.")
    ] = False,
    json: Json = False,
) -> None:
    """Check a world file, or a file with a string.

    The exit code is 0, or 1 with the error and its place. This runs the Python code that the
    world file or --vocabulary names. Use --no-code for files from untrusted sources.
    """
    if no_code and vocabulary:
        raise MisuseError("--vocabulary runs code")
    from minerva_bus.api.checking import check as checked
    from minerva_bus.cli.output import print_json, print_message, print_result

    answer: dict[str, Any] = {"file": str(file), "ok": True}
    try:
        with uncollected():
            result = checked(file, vocabulary=vocabulary, code=not no_code)
        answer["what"] = result.what
        answer |= {"code": result.code} if no_code and file.suffix == ".toml" else {}
        answer |= {"warnings": result.warnings} if result.warnings else {}
    except MinervaError as error:
        answer |= {"ok": False, "error": str(error)}
        if isinstance(error, SceneError):
            answer |= {"line": error.line, "column": error.column, "expected": error.expected}
    if json:
        print_json(answer)
    elif answer["ok"]:
        print_result(f"{file}: {answer['what']}")
        for name in answer.get("code", []):
            print_result(f"  not run: {name}")
        for warning in answer.get("warnings", []):
            print_message(f"warning: {warning}")
    else:
        print_message(answer["error"])
    raise typer.Exit(0 if answer["ok"] else 1)


@examples(
    "minerva attach svg --path now.svg",
    "minerva attach garden:Snail --connect tls/host:7447 --keys keys --name hostA",
)
@grouped
def attach(
    context: typer.Context,
    spec: Annotated[
        str,
        typer.Argument(
            help="A service's name, or module:Class.", autocompletion=completing.members_to_attach
        ),
    ],
    join: JoinOptions,
    process: Annotated[str, typer.Option(help="Run this process of the world file SPEC.")] = "",
    standby: Annotated[
        bool, typer.Option("--standby", help="Wait, and take the place of the process if it goes.")
    ] = False,
) -> None:
    """Attach agents, a service or a view to a world.

    It stays until Ctrl-C. Other options are passed to the service: `attach svg --every 5`. With
    --process they are options of the world: `attach robot --process physics --map house.yaml`.
    """
    from minerva_bus.cli.attaching import attach_member

    options = options_of(context.args)
    raise typer.Exit(attach_member(spec, join, options, process, standby=standby))


@examples("minerva worlds", "minerva worlds --json")
def worlds(json: Json = False) -> None:
    """List the installed worlds.

    `minerva run NAME` runs one; `minerva new world MINE --from NAME` copies it.
    """
    from minerva_bus.cli.output import print_json, print_result
    from minerva_bus.launch.installed import installed_worlds

    descriptions = installed_worlds()
    if json:
        print_json(descriptions)
        return
    width = max(map(len, descriptions), default=0)
    for name, text in descriptions.items():
        print_result(f"{name:{width}}  {text}")
