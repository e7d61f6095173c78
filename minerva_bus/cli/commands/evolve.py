"""`minerva evolve`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from minerva_bus.cli.options import Force, Json, Quiet, Settings
from minerva_bus.cli.words import options_of

World = Annotated[str, typer.Argument(help="A world file, or an installed world's name.")]
Frames = Annotated[int | None, typer.Option(help="Frames per run.", min=1)]
Limit = Annotated[float, typer.Option(help="Time limit of a run, seconds.", min=0.1)]
Workers = Annotated[int, typer.Option(help="Parallel runs; 0: one per core.", min=0)]
InProcess = Annotated[
    bool, typer.Option(help="Run each world in one process, without a bus: faster, same result.")
]

EXAMPLES = (
    "minerva evolve forager.toml --fitness forager:berries --generations 20",
    "minerva evolve forager.toml --fitness forager:berries --mutable AEgg.speed=0:0.4",
)


def command(
    context: typer.Context,
    world: World,
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
    frames: Frames = None,
    limit: Limit = 60.0,
    trials: Annotated[int, typer.Option(help="Runs per string, with seed, seed+1, ...", min=1)] = 1,
    workers: Workers = 0,
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
            "--output", "-o", help="Save the best string, .mnv or .toml; may be repeated."
        ),
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="Plot fitness over generations.")] = None,
    tree: Annotated[Path | None, typer.Option(help="Plot the family tree.")] = None,
    in_process: InProcess = False,
    json: Json = False,
    quiet: Quiet = False,
    force: Force = False,
) -> None:
    """Evolve the string of a world by a genetic algorithm.

    The world's own options, declared in its [options], are options here too.
    """
    from minerva_bus.cli.evolving import EvolveOptions, evolve_world, read_fitness
    from minerva_bus.cli.running import read_world
    from minerva_bus.launch.console import Console
    from minerva_bus.settings.overrides import Overrides
    from minerva_bus.study.evolution import Plan
    from minerva_bus.study.saving import WorldOptions
    from minerva_bus.study.trial import prepared
    from minerva_bus.study.workers import how_many

    options, settings = options_of(context.args), tuple(set_ or ())
    overrides = Overrides(options, settings, seed=seed, rate=0.0, frames=frames)
    file = prepared(read_world(world, overrides))
    wanted = EvolveOptions(
        read_fitness(fitness, file),
        Plan(population, generations, file.world.seed, minimise, compare_random),
        tuple(mutable or ()), nodes, how_many(workers), limit, trials, in_process,
        tuple(output or ()), plot, tree,
        WorldOptions(settings, frozenset(options), frames),
    )  # fmt: skip
    raise typer.Exit(evolve_world(file, wanted, Console(quiet=quiet), json))
