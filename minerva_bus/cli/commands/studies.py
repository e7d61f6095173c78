"""`minerva evolve` and `sweep`: one world, run many times."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from minerva_bus.cli.options import UNKNOWN_TOO, Force, Json, Quiet, Settings
from minerva_bus.cli.words import options_of

app = typer.Typer()

World = Annotated[str, typer.Argument(help="A world file, or an installed world's name.")]
Frames = Annotated[int | None, typer.Option(help="Frames of each run.", min=1)]
Limit = Annotated[float, typer.Option(help="Seconds that a run may take.", min=0.1)]
Workers = Annotated[int, typer.Option(help="Runs at a time; 0: one a core.", min=0)]
InProcess = Annotated[
    bool, typer.Option(help="Each world in one process, without a bus: faster, the same.")
]


@app.command(context_settings=UNKNOWN_TOO)
def evolve(
    context: typer.Context,
    world: World,
    fitness: Annotated[
        str, typer.Option(help="module:function of a run's Outcome; returns a number.")
    ],
    population: Annotated[int, typer.Option(help="Strings in a generation.", min=2)] = 20,
    generations: Annotated[int, typer.Option(help="Generations after the first.", min=0)] = 10,
    mutable: Annotated[
        list[str] | None,
        typer.Option(help="What may change: SYMBOL, #ID, A/B.NAME=LOW:HIGH; default: all."),
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Seed of the worlds and of evolution.")] = None,
    frames: Frames = None,
    limit: Limit = 60.0,
    trials: Annotated[
        int, typer.Option(help="Runs of each string, with seed, seed+1, ...", min=1)
    ] = 1,
    workers: Workers = 0,
    minimise: Annotated[bool, typer.Option("--minimise", help="Less is better.")] = False,
    nodes: Annotated[int, typer.Option(help="Nodes that a string may grow to.", min=1)] = 1000,
    compare_random: Annotated[
        bool, typer.Option("--compare-random", help="Judge as many strings drawn at random.")
    ] = False,
    set_: Settings = None,
    output: Annotated[
        list[Path] | None,
        typer.Option("--output", "-o", help="Save the best: .mnv or .toml; may be repeated."),
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="Draw fitness over generations.")] = None,
    tree: Annotated[Path | None, typer.Option(help="Draw who descends from whom.")] = None,
    in_process: InProcess = False,
    json: Json = False,
    quiet: Quiet = False,
    force: Force = False,
) -> None:
    """Let a world's string evolve: strings mutate and cross, worlds run, the fittest stay.

    A world's own options, as its [options] say, are options here too.
    """
    from minerva_bus.cli.evolving import Wanted, evolve_world, read_fitness
    from minerva_bus.cli.running import read_world
    from minerva_bus.launch.console import Console
    from minerva_bus.settings.overrides import Overrides
    from minerva_bus.study.evolution import Plan
    from minerva_bus.study.saving import Given
    from minerva_bus.study.trial import prepared
    from minerva_bus.study.workers import how_many

    options, settings = options_of(context.args), tuple(set_ or ())
    overrides = Overrides(options, settings, seed=seed, rate=0.0, frames=frames)
    file = prepared(read_world(world, overrides))
    wanted = Wanted(
        read_fitness(fitness, file),
        Plan(population, generations, file.world.seed, minimise, compare_random),
        tuple(mutable or ()), nodes, how_many(workers), limit, trials, in_process,
        tuple(output or ()), plot, tree,
        Given(settings, frozenset(options), frames),
    )  # fmt: skip
    raise typer.Exit(evolve_world(file, wanted, Console(quiet=quiet), json))


@app.command(context_settings=UNKNOWN_TOO)
def sweep(
    context: typer.Context,
    world: World,
    set_: Annotated[
        list[str],
        typer.Option("--set", help="KEY=A,B,... or KEY=FROM:TO[:STEP]; an option, seed, PROC.KEY."),
    ],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="The table, .csv or .parquet; default: WORLD.csv."),
    ] = None,
    frames: Frames = None,
    limit: Limit = 600.0,
    workers: Workers = 0,
    plot: Annotated[Path | None, typer.Option(help="Draw the runs side by side.")] = None,
    in_process: InProcess = False,
    json: Json = False,
    quiet: Quiet = False,
    force: Force = False,
) -> None:
    """Run a world with all combinations of some options; what is in the table is not run again.

    Other options of the world, as its [options] say, hold for all runs.
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
