"""`minerva explain`: the causes of a value in a record, and of a world that does not advance."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from minerva_bus.api.records import explain
from minerva_bus.cli.options import WorldTarget
from minerva_bus.cli.output import print_answer
from minerva_bus.cli.places import client
from minerva_bus.errors import MisuseError
from minerva_bus.launch.explaining import explain_world
from minerva_bus.log.causes import explain_value
from minerva_bus.log.reader import Record


def explain_running(target: WorldTarget, as_json: bool) -> None:
    """Print why a running world does not advance. Raises BusError."""
    with client(target) as world:
        print_answer(explain_world(world.operator), as_json)


@dataclass(frozen=True, slots=True)
class ValueQuestion:
    """An attribute of an agent in a record; `code` names a world file that has moved."""

    file: Path
    code: str
    agent: str
    attribute: str
    frame: int | None
    no_code: bool


def explain_record(question: ValueQuestion, as_json: bool) -> None:
    """Print how an attribute got its value. Raises RecordError and WorldFileError."""
    file, agent, attribute = question.file, question.agent, question.attribute
    for option, given in (("--agent ID", agent), ("--attribute NAME", attribute)):
        if not given:
            hint = f"minerva info {file} --string lists the agents and their attributes"
            raise MisuseError(f"explain {file}: {option} is missing; {hint}")
    if question.no_code and question.code:
        raise MisuseError(f"{question.code} has code, which --no-code forbids")
    if question.no_code:
        with Record(file) as record:
            explanation = explain_value(
                record, {}, agent.removeprefix("#"), attribute, question.frame
            )
    else:
        explanation = explain(file, agent, attribute, question.frame, question.code)
    print_answer(explanation, as_json)
