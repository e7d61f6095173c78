"""Commands that run a world many times."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from minerva_bus.cli import completing
from minerva_bus.cli.grouping import grouped
from minerva_bus.cli.options import (
    ComparisonPlot,
    Force,
    Json,
    MovedWorld,
    QuietStudy,
    Settings,
    WorldArgument,
    examples,
    options_of,
)
from minerva_bus.cli.study_options import BranchOptions, Limit, StudyOptions, open_workers


@examples(
    "minerva evolve forager.toml --fitness forager:berries --generations 20",
    "minerva evolve forager.toml --fitness forager:berries --mutable AEgg.speed=0:0.4",
    "minerva evolve forager.toml --fitness forager:berries --dask cluster:8786",
)
@grouped
def evolve(
    context: typer.Context,
    world: WorldArgument,
    fitness: Annotated[
        str,
        typer.Option(help="module:function that takes the Outcome of a run and returns a number."),
    ],
    population: Annotated[int, typer.Option(help="Strings per generation.", min=2)] = 20,
    generations: Annotated[int, typer.Option(help="Generations after the first.", min=0)] = 10,
    mutable: Annotated[
        list[str] | None,
        typer.Option(help="What may mutate: SYMBOL, #ID, A/B.NAME=LOW:HIGH; default: all."),
    ] = None,
    seed: Annotated[
        int | None, typer.Option(help="Seed of the worlds and of the evolution.")
    ] = None,
    limit: Limit = 60.0,
    trials: Annotated[int, typer.Option(help="Runs per string, with seed, seed+1, ...", min=1)] = 1,
    minimise: Annotated[bool, typer.Option("--minimise", help="Minimise the fitness.")] = False,
    nodes: Annotated[int, typer.Option(help="Maximum number of nodes of a string.", min=1)] = 1000,
    compare_random: Annotated[
        bool,
        typer.Option("--compare-random", help="Also evaluate the same number of random strings."),
    ] = False,
    set_: Settings = None,
    output: Annotated[
        list[Path] | None,
        typer.Option(
            "--output",
            "-o",
            help="The best string (.mnv, .toml) or all of them (.csv, .parquet); may be repeated.",
        ),
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="Plot fitness over generations.")] = None,
    tree: Annotated[Path | None, typer.Option(help="Plot the family tree.")] = None,
    json: Json = False,
    quiet: QuietStudy = False,
    force: Force = False,
    *,
    study: StudyOptions,
) -> None:
    """Evolve the string of a world by a genetic algorithm.

    The world's own options, declared in its [options], are options here too.
    """
    from minerva_bus.cli.evolving import EvolveOptions, evolve_world, read_fitness
    from minerva_bus.cli.running import read_world
    from minerva_bus.launch.console import Console
    from minerva_bus.settings.overrides import Overrides
    from minerva_bus.study.evolution import Plan
    from minerva_bus.study.executor_pool import Workers
    from minerva_bus.study.saving import WorldOptions
    from minerva_bus.study.trial import prepared

    options, settings = options_of(context.args), tuple(set_ or ())
    overrides = Overrides(options, settings, seed=seed, rate=0.0, frames=study.frames)
    file = prepared(read_world(world, overrides))
    wanted = EvolveOptions(
        read_fitness(fitness, file),
        Plan(population, generations, file.world.seed, minimise, compare_random),
        tuple(mutable or ()), nodes, Workers(study.workers, limit), trials, study.in_process,
        tuple(output or ()), plot, tree,
        WorldOptions(settings, frozenset(options), study.frames), overrides,
    )  # fmt: skip
    with open_workers(study.workers, study.dask, limit) as workers:
        wanted = replace(wanted, workers=workers)
        code = evolve_world(file, wanted, Console(quiet=quiet), json)
    raise typer.Exit(code)


@examples(
    "minerva sweep flock.toml --set birds=100,300,1000 --output birds.csv",
    "minerva sweep robot --set seed=1:20 --frames 2000 --plot seeds.png",
    "minerva sweep flock.toml --set seed=0:1000 --frames 500 --dask cluster:8786",
)
@grouped
def sweep(
    context: typer.Context,
    world: WorldArgument,
    set_: Annotated[
        list[str],
        typer.Option(
            "--set",
            help="KEY=A,B,... or KEY=FROM:TO[:STEP]; KEY: an option, seed, PROCESS.KEY,"
            " SYMBOL.NAME or #ID.NAME.",
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", help="The table of results, .csv or .parquet; default: WORLD.csv."
        ),
    ] = None,
    limit: Limit = 600.0,
    plot: ComparisonPlot = None,
    json: Json = False,
    quiet: QuietStudy = False,
    force: Force = False,
    *,
    study: StudyOptions,
) -> None:
    """Run a world with all combinations of options.

    Rows that are already in the table are kept. Other options of the world apply to all runs.
    """
    from minerva_bus.cli.sweeping import sweep_world
    from minerva_bus.launch.console import Console
    from minerva_bus.launch.installed import find_world
    from minerva_bus.launch.reading import read_world_file
    from minerva_bus.launch.toml import read_toml
    from minerva_bus.settings.overrides import AS_WRITTEN, Overrides
    from minerva_bus.study.code_digests import identity, named_objects
    from minerva_bus.study.grid import parse_grid
    from minerva_bus.study.sent_world import SentWorld
    from minerva_bus.study.sweep import Sweep

    path, grid = find_world(world), parse_grid(set_)
    given = Overrides(options_of(context.args), frames=study.frames, rate=0.0)
    runs = Sweep(path, grid, given, study.in_process)
    file = read_world_file(path, given)
    tables = read_toml(file.text)
    runs.identity = identity(tables, file, named_objects(tables, path.parent))
    if study.dask:
        runs.sent = SentWorld.of(file.text, path, AS_WRITTEN)
    table = output or Path(f"{path.stem}.csv")
    console = Console(quiet=quiet)
    with open_workers(study.workers, study.dask, limit) as workers:
        code = sweep_world(runs, table, plot, workers, console, json)
    raise typer.Exit(code)


@examples(
    "minerva branch run.mcap --frame 400 --seeds 20",
    "minerva branch run.mcap --frame 400 --set weather.amount=0.005,0.02 --seeds 5",
    "minerva branch run.mcap --frame 400 --runs 100 --tree tree.svg",
    "minerva branch run.mcap --frame 400 --runs 1000 --dask cluster:8786",
)
@grouped
def branch(
    file: Annotated[
        Path, typer.Argument(help="A record, .mcap.", autocompletion=completing.records)
    ],
    frame: Annotated[int, typer.Option(help="Continue from the string of this frame.", min=0)],
    world: MovedWorld = "",
    set_: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            help="KEY=A,B,... or KEY=FROM:TO[:STEP]; KEY: an option, seed, PROCESS.KEY,"
            " SYMBOL.NAME or #ID.NAME.",
        ),
    ] = None,
    seeds: Annotated[
        int | None,
        typer.Option(help="Seeds of each combination, the first that of the record.", min=1),
    ] = None,
    runs: Annotated[
        int | None,
        typer.Option(
            help="Number of runs, by as many seeds; with --seeds, the limit of runs.", min=1
        ),
    ] = None,
    frames: Annotated[
        int | None, typer.Option(help="Last frame; default: that of the record.", min=1)
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            help="The table of results, .csv or .parquet; default: NAME-FRAME.csv.",
        ),
    ] = None,
    limit: Limit = 600.0,
    plot: ComparisonPlot = None,
    tree: Annotated[Path | None, typer.Option(help="Plot the record and its branches.")] = None,
    json: Json = False,
    quiet: QuietStudy = False,
    force: Force = False,
    *,
    study: BranchOptions,
) -> None:
    """Continue a recorded run from one of its frames in many ways.

    The runs have all combinations of seeds and --set. The one without a change has the strings of
    the record, which is checked: the exit code is 1 if it differs. Rows that are already in the
    table are kept. Like replay, this runs the Python code of the world file that the record names.
    """
    from minerva_bus.api.branching import Branches
    from minerva_bus.cli.branching import BranchFiles, branch_record, grid_of_branches
    from minerva_bus.launch.console import Console
    from minerva_bus.settings.overrides import Overrides

    branches = Branches.read(file, frame, world)
    grid = grid_of_branches(branches, tuple(set_ or ()), seeds, runs)
    given = Overrides(frames=frames)
    sweep = branches.sweep(grid, given, in_process=study.in_process, sent=bool(study.dask))
    files = BranchFiles(output or Path(f"{file.stem}-{frame}.csv"), plot, tree)
    with open_workers(study.workers, study.dask, limit) as workers:
        code = branch_record(branches, sweep, files, workers, Console(quiet=quiet), json)
    raise typer.Exit(code)
