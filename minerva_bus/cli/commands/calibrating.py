"""The command that searches for options."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from minerva_bus.cli import completing
from minerva_bus.cli.options import Collect, Force, Json, QuietStudy, examples, options_of
from minerva_bus.cli.study_options import (
    DaskOption,
    FramesOption,
    Limit,
    WorkersOption,
    open_workers,
)


@examples(
    "minerva calibrate robot --range speed=0.2:0.8 --objective distance_driven --maximise",
    "minerva calibrate meadow --range weather.amount=0.005:0.05 --objective rabbits --maximise"
    " --collect 'rabbits=count(ARabbit)' --seeds 3 --frames 200",
    "minerva calibrate garden.toml --range AFox.speed=0:2 --range '#anna.water=0:10'"
    " --objective targets:eaten --maximise",
    "minerva calibrate run.mcap --frame 400 --range rain=0:0.4 --objective targets:distance",
)
def calibrate(
    context: typer.Context,
    world: Annotated[
        str,
        typer.Argument(
            help="A world file or installed world; with --frame a record, .mcap.",
            autocompletion=completing.worlds_and_records,
        ),
    ],
    range_: Annotated[
        list[str],
        typer.Option(
            "--range",
            help="KEY=LOW:HIGH or KEY=A,B,...; KEY: an option, PROCESS.KEY, SYMBOL.NAME or"
            " #ID.NAME.",
        ),
    ],
    objective: Annotated[
        str,
        typer.Option(
            help="A column, of which the mean over the rows of a trial counts, or module:function,"
            " which takes these rows, a DataTable, and returns a number."
        ),
    ],
    maximise: Annotated[bool, typer.Option("--maximise", help="More is better, not less.")] = False,
    trials: Annotated[int, typer.Option(help="Number of trials.", min=1)] = 40,
    seeds: Annotated[int, typer.Option(help="Runs of each trial.", min=1)] = 1,
    sampler: Annotated[
        str, typer.Option(help="Of Optuna: tpe, cma-es, nsga-ii or random.")
    ] = "tpe",
    seed: Annotated[int, typer.Option(help="Seed of the sampler.", min=0)] = 0,
    collect: Collect = None,
    frame: Annotated[
        int | None, typer.Option(help="Branch from this frame of the record.", min=0)
    ] = None,
    frames: FramesOption = None,
    workers: WorkersOption = 0,
    dask: DaskOption = "",
    limit: Limit = 600.0,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            help="Table of trials, .csv or .parquet; default: NAME-trials.csv.",
        ),
    ] = None,
    json: Json = False,
    quiet: QuietStudy = False,
    force: Force = False,
) -> None:
    """Search for the best values of options and parameters.

    Each trial sets options of the world or of its processes, or parameters of its string, to values
    that a sampler of Optuna chooses. The world's own options apply to all runs. Finished runs are
    in the folder TABLE.runs: the same command continues with them.
    """
    from minerva_bus.cli.calibrating import Search, calibrate_world, read_ranges
    from minerva_bus.launch.console import Console

    search = Search(
        world, objective, read_ranges(tuple(range_)), maximise, trials, seeds,
        sampler, seed, tuple(collect or ()), frame, frames, options_of(context.args),
    )  # fmt: skip
    table = output or Path(f"{Path(world).stem}-trials.csv")
    with open_workers(workers, dask, limit) as chosen:
        code = calibrate_world(search, table, chosen, Console(quiet=quiet), json)
    raise typer.Exit(code)
