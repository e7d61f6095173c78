"""The command that explains values of a record."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from minerva_bus.cli import completing, completing_agents
from minerva_bus.cli.options import Json, examples
from minerva_bus.cli.startup import uncollected


@examples(
    "minerva explain run.mcap --agent r1 --attribute objective --frame 340",
    "minerva explain run.mcap --agent f2 --attribute energy --json",
)
def explain(
    file: Annotated[
        Path, typer.Argument(help="A record, .mcap.", autocompletion=completing.records)
    ],
    world: Annotated[
        str,
        typer.Argument(
            help="World file or installed world, if the original one has moved.",
            autocompletion=completing.worlds,
        ),
    ] = "",
    agent: Annotated[
        str, typer.Option(help="Id of the agent.", autocompletion=completing_agents.agents)
    ] = "",
    attribute: Annotated[
        str,
        typer.Option(help="Its attribute.", autocompletion=completing_agents.attributes),
    ] = "",
    frame: Annotated[
        int | None,
        typer.Option(help="Explain the value at the beginning of this frame; default: the end."),
    ] = None,
    json: Json = False,
) -> None:
    """Explain a value of a recorded run.

    It prints the frame in which the value changed last, the method, the event that caused the call,
    who sent it and why, back to a generator, a person or the initial string; and what norms have
    rejected since. Like replay, this runs the Python code of the world file that the record names.
    """
    with uncollected():
        from minerva_bus.cli.explaining import explain_record

    explain_record(file, world, agent, attribute, frame, json)
