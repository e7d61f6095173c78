"""`minerva graph`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from minerva_bus.cli.options import (
    Connect,
    Force,
    Json,
    Takes,
    WorldArgument,
    WorldTarget,
    examples,
    grouped,
    options_of,
)
from minerva_bus.settings.world_settings import Overrides

if TYPE_CHECKING:
    from minerva_bus.world.operator import WorldStatus

TOPIC: Final = "Run"


MEASURE_SECONDS: Final = 1.0
"""Time for a running world to measure its rates, which begins with the first question."""


@examples(
    "minerva graph robot --output robot.mmd",
    "minerva graph robot --live",
    "minerva graph garden.toml --view web --json",
)
@grouped
def graph(
    context: typer.Context,
    overrides: Annotated[Overrides, Takes("view", "set_")],
    world: WorldArgument,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="A .mmd file; default: standard output.")
    ] = None,
    live: Annotated[
        bool, typer.Option("--live", help="Add the rates of the running world of this name.")
    ] = False,
    connect: Connect = "",
    json: Json = False,
    force: Force = False,
) -> None:
    """Print how events flow between processes and agents.

    It is Mermaid text, which GitHub and many editors draw. Event types are in the order of a frame.
    The world is read, not run: this runs the Python code that the world file names, but no frame.
    Its own options are options here too. With --live, the running world says how many events of
    each type its frames have, and how many bytes each process sends.
    """
    from minerva_analysis.graphs import check_writable, graph_of
    from minerva_bus.cli.output import print_json, print_result
    from minerva_bus.cli.run_choice import read_world

    given = Overrides(options_of(context.args), overrides.settings, overrides.views)
    if output is not None:
        check_writable(output)
    file = read_world(world, given)
    made = graph_of(file)
    if live or connect:
        made = made.with_rates(_measured(connect, file.world.name))
    if output is not None:
        made.save(output)
    if json:
        print_json(made.plain())
    else:
        print_result(made.mermaid().rstrip() if output is None else str(output))


def _measured(connect: str, world: str) -> WorldStatus:
    """The state of a running world with its rates. Raises MinervaError if it does not answer."""
    import time

    from minerva_bus.cli.places import client

    with client(WorldTarget(connect=connect, world=world)) as running:
        running.operator.status()
        time.sleep(MEASURE_SECONDS)
        return running.operator.status()
