"""`minerva run`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from minerva_bus.cli.options import (
    Force,
    RunOptions,
    Takes,
    grouped,
)
from minerva_bus.cli.startup import BEGAN, uncollected
from minerva_bus.cli.words import options_of
from minerva_bus.errors import MinervaError
from minerva_bus.settings.overrides import Overrides

EXAMPLES = (
    "minerva run robot --view web",
    "minerva run garden.toml --frames 100 --seed 7 --record garden.mcap",
)


@grouped
def command(
    context: typer.Context,
    overrides: Annotated[
        Overrides,
        Takes(
            *("seed", "rate", "frames", "view", "set_", "name", "until"),
            *("record", "record_topics", "flush", "durable", "journal", "collect"),
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
    """Run a world.

    The world's own options, declared in its [options], are options here too: `minerva run WORLD
    --help` lists them.
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
