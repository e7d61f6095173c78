"""`minerva sweep`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from minerva_bus.cli.options import Force, Json, Quiet
from minerva_bus.cli.words import options_of

World = Annotated[str, typer.Argument(help="A world file, or an installed world's name.")]
Frames = Annotated[int | None, typer.Option(help="Frames per run.", min=1)]
Limit = Annotated[float, typer.Option(help="Time limit of a run, seconds.", min=0.1)]
Workers = Annotated[int, typer.Option(help="Parallel runs; 0: one per core.", min=0)]
InProcess = Annotated[
    bool, typer.Option(help="Run each world in one process, without a bus: faster, same result.")
]

EXAMPLES = (
    "minerva sweep flock.toml --set birds=100,300,1000 --output birds.csv",
    "minerva sweep robot --set seed=1:20 --frames 2000 --plot seeds.png",
)


def command(
    context: typer.Context,
    world: World,
    set_: Annotated[
        list[str],
        typer.Option(
            "--set", help="KEY=A,B,... or KEY=FROM:TO[:STEP]; KEY: an option, seed or PROCESS.KEY."
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", help="The table of results, .csv or .parquet; default: WORLD.csv."
        ),
    ] = None,
    frames: Frames = None,
    limit: Limit = 600.0,
    workers: Workers = 0,
    plot: Annotated[Path | None, typer.Option(help="Plot a comparison of the runs.")] = None,
    in_process: InProcess = False,
    json: Json = False,
    quiet: Quiet = False,
    force: Force = False,
) -> None:
    """Run a world with all combinations of options.

    Rows that are already in the table are kept. Other options of the world apply to all runs.
    """
    from minerva_bus.cli.sweeping import sweep_world
    from minerva_bus.launch.console import Console
    from minerva_bus.launch.specs import find_world
    from minerva_bus.settings.overrides import Overrides
    from minerva_bus.study.grid import parse_grid
    from minerva_bus.study.sweep import Sweep
    from minerva_bus.study.workers import how_many

    path, grid = find_world(world), parse_grid(set_)
    given = Overrides(options_of(context.args), frames=frames, rate=0.0)
    found = Sweep(path, grid, given, in_process)
    table = output or Path(f"{path.stem}.csv")
    console = Console(quiet=quiet)
    raise typer.Exit(sweep_world(found, table, plot, how_many(workers), limit, console, json))
