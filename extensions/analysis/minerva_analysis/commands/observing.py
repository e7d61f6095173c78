"""`minerva explain`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final

import typer

from minerva_analysis.commands import completing as contents
from minerva_bus.cli import completing
from minerva_bus.cli.options import Json, NamedTarget, WorldTarget, examples, grouped
from minerva_bus.files import ending_of
from minerva_bus.process_life import uncollected

TOPIC: Final = "Observe"


@examples(
    "minerva explain run.mcap --agent r1 --attribute objective --frame 340",
    "minerva explain meadow",
    "minerva explain meadow --agent f1 --attribute energy",
)
@grouped
def explain(
    record: Annotated[
        str,
        typer.Argument(
            metavar="RECORD|WORLD",
            help="A record, .mcap, or a running world.",
            autocompletion=contents.records_and_running,
        ),
    ] = "",
    code: Annotated[
        str,
        typer.Argument(
            metavar="FILE",
            help="Its world file or installed world, if that has moved.",
            autocompletion=completing.worlds,
        ),
    ] = "",
    agent: Annotated[
        str, typer.Option(help="Id of the agent.", autocompletion=contents.agents)
    ] = "",
    attribute: Annotated[
        str, typer.Option(help="Its attribute.", autocompletion=contents.attributes)
    ] = "",
    frame: Annotated[
        int | None,
        typer.Option(help="Explain the value at the beginning of this frame; default: the end."),
    ] = None,
    no_code: Annotated[
        bool, typer.Option("--no-code", help="Run no code: explain by recorded events only.")
    ] = False,
    json: Json = False,
    *,
    target: WorldTarget,
) -> None:
    """Explain a value of an agent, or why a world stops.

    With --agent, it prints the frame in which the value of --attribute changed, the method, the
    event that caused the call, who sent it and why, back to a generator, a person or the initial
    string; and what norms have rejected since. Like replay, this runs the Python code of the world
    file that the record names; --no-code runs none, and names no methods. Of a running world, the
    frames are those in its journal and in its record, if it has one.

    Without --attribute, it prints the agent's state, the events that it received in the last
    frames, and what norms have rejected.

    Without --agent, it prints who is awaited, in which call, what happens next and what to do.
    """
    with uncollected():
        from minerva_analysis.explain_command import ValueQuestion, explain_record, explain_running

    question = ValueQuestion(code, agent, attribute, frame, no_code)
    if ending_of(record) == ".mcap":
        explain_record(Path(record), question, json)
        return
    name = NamedTarget(target.connect, target.keys, target.world, record)
    explain_running(name, question, json)
