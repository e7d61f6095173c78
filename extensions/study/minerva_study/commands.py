"""`minerva sweep`, `branch`, `calibrate` and `evolve`, and the options that they have in common."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from minerva_bus.cli import completing
from minerva_bus.cli.options import (
    Collect,
    Force,
    Json,
    MovedWorld,
    Settings,
    WorldArgument,
    examples,
    grouped,
    options_of,
)

if TYPE_CHECKING:
    from minerva_study.executor_pool import Workers

TOPIC: Final = "Studies"

Limit = Annotated[float, typer.Option(help="Time limit of a run, seconds.", min=0.1)]

ComparisonPlot = Annotated[Path | None, typer.Option(help="Plot a comparison of the runs.")]
QuietStudy = Annotated[bool, typer.Option(help="Print errors and the result only.")]
WorkersOption = Annotated[int, typer.Option(help="Parallel runs; 0: one per core.", min=0)]
FramesOption = Annotated[int | None, typer.Option(help="Frames per run.", min=1)]
DaskOption = Annotated[
    str,
    typer.Option(
        help="Run in the workers of a Dask cluster, each world in one process: HOST:PORT of its"
        " scheduler."
    ),
]


@dataclass(frozen=True, slots=True)
class BranchOptions:
    """Options of all studies."""

    workers: WorkersOption = 0
    in_process: Annotated[
        bool,
        typer.Option(help="Run each world in one process, without a bus: faster, same result."),
    ] = False
    dask: DaskOption = ""


@dataclass(frozen=True, slots=True)
class StudyOptions(BranchOptions):
    """Options of studies of whole runs."""

    frames: FramesOption = None


@contextmanager
def open_workers(workers: int, dask: str, limit: float) -> Generator[Workers]:
    """The workers of the options: a Dask cluster, or processes of this machine.

    Raises MisuseError if there is no cluster at this address.
    """
    from minerva_study.executor_pool import Workers, dask_executor

    if not dask:
        yield Workers(workers, limit)
        return
    with dask_executor(dask) as executor:
        yield Workers(0, limit, executor)


@completing.completer
def _worlds_and_records(ctx: typer.Context, incomplete: str) -> completing.Choices:
    """Installed worlds, world files and records."""
    return [*completing.installed(ctx, incomplete), *completing.paths(incomplete, ".toml", ".mcap")]


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
    from minerva_bus.cli.run_choice import read_world
    from minerva_bus.launch.console import Console
    from minerva_bus.settings.world_settings import Overrides
    from minerva_study.evolution import Plan
    from minerva_study.evolve_command import EvolveOptions, evolve_world, read_fitness
    from minerva_study.executor_pool import Workers
    from minerva_study.saving import WorldOptions
    from minerva_study.trial import prepared

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
    from minerva_bus.launch.console import Console
    from minerva_bus.launch.installed import find_world
    from minerva_bus.launch.toml_tables import read_toml
    from minerva_bus.launch.world_files import read_world_file
    from minerva_bus.settings.world_settings import AS_WRITTEN, Overrides
    from minerva_study.code_digests import identity, named_objects
    from minerva_study.grid import parse_grid
    from minerva_study.sent_world import SentWorld
    from minerva_study.sweep_command import sweep_world
    from minerva_study.sweep_runs import Sweep

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
    from minerva_bus.launch.console import Console
    from minerva_bus.settings.world_settings import Overrides
    from minerva_study.branch_command import BranchFiles, branch_record, grid_of_branches
    from minerva_study.branching import Branches

    branches = Branches.read(file, frame, world)
    grid = grid_of_branches(branches, tuple(set_ or ()), seeds, runs)
    given = Overrides(frames=frames)
    sweep = branches.sweep(grid, given, in_process=study.in_process, sent=bool(study.dask))
    files = BranchFiles(output or Path(f"{file.stem}-{frame}.csv"), plot, tree)
    with open_workers(study.workers, study.dask, limit) as workers:
        code = branch_record(branches, sweep, files, workers, Console(quiet=quiet), json)
    raise typer.Exit(code)


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
            autocompletion=_worlds_and_records,
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
    from minerva_bus.launch.console import Console
    from minerva_study.calibrate_command import Search, calibrate_world, read_ranges

    search = Search(
        world, objective, read_ranges(tuple(range_)), maximise, trials, seeds,
        sampler, seed, tuple(collect or ()), frame, frames, options_of(context.args),
    )  # fmt: skip
    table = output or Path(f"{Path(world).stem}-trials.csv")
    with open_workers(workers, dask, limit) as chosen:
        code = calibrate_world(search, table, chosen, Console(quiet=quiet), json)
    raise typer.Exit(code)
