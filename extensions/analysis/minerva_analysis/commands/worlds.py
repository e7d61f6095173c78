"""`minerva graph`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final

import typer

from minerva_bus.cli.options import Force, Json, Takes, WorldArgument, examples, grouped, options_of
from minerva_bus.settings.world_settings import Overrides

TOPIC: Final = "Run"


@examples(
    "minerva graph robot --output robot.mmd",
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
    json: Json = False,
    force: Force = False,
) -> None:
    """Print how events flow between processes and agents.

    It is Mermaid text, which GitHub and many editors draw. Event types are in the order of a frame.
    The world is read, not run: this runs the Python code that the world file names, but no frame.
    Its own options are options here too.
    """
    from minerva_analysis.graphs import check_writable, graph_of
    from minerva_bus.cli.output import print_json, print_result
    from minerva_bus.cli.run_choice import read_world

    given = Overrides(options_of(context.args), overrides.settings, overrides.views)
    if output is not None:
        check_writable(output)
    made = graph_of(read_world(world, given))
    if output is not None:
        made.save(output)
    if json:
        print_json(made.plain())
    else:
        print_result(made.mermaid().rstrip() if output is None else str(output))
