"""`minerva explain`: the causes of a value in a record, and of a world that does not advance."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from minerva_analysis.explaining import explain_running_value, explain_world, explained_in
from minerva_bus.cli.options import WorldTarget
from minerva_bus.cli.output import print_answer
from minerva_bus.cli.places import client
from minerva_bus.errors import MisuseError
from minerva_bus.log.record import Record


@dataclass(frozen=True, slots=True)
class ValueQuestion:
    """An agent, and an attribute or ""; `code` names a world file that has moved."""

    code: str
    agent: str
    attribute: str
    frame: int | None
    no_code: bool

    @property
    def is_asked(self) -> bool:
        """Whether it is about a value at all."""
        return bool(self.agent or self.attribute or self.frame is not None)

    @property
    def source(self) -> str | None:
        """The world with the code of the agents; None if no code may run."""
        return None if self.no_code else self.code

    def check(self, about: str, hint: str) -> None:
        """Raise MisuseError if the question is incomplete; `about` is its record or world."""
        if not self.agent:
            raise MisuseError(f"explain {about}: --agent ID is missing; {hint}")
        if self.no_code and self.code:
            raise MisuseError(f"{self.code} has code, which --no-code forbids")


def explain_running(target: WorldTarget, question: ValueQuestion, as_json: bool) -> None:
    """Print why a running world does not advance, or how an attribute got its value.

    Raises BusError, RecordError and WorldFileError.
    """
    with client(target) as world:
        if not question.is_asked:
            print_answer(explain_world(world.operator), as_json)
            return
        question.check(world.world, "minerva echo KIND shows agents with their attributes")
        agent, attribute = question.agent.removeprefix("#"), question.attribute
        print_answer(
            explain_running_value(
                world.operator, question.source, agent, attribute, question.frame
            ),
            as_json,
        )


def explain_record(file: Path, question: ValueQuestion, as_json: bool) -> None:
    """Print how an attribute got its value, or without one what its agent received.

    Raises RecordError and WorldFileError.
    """
    question.check(str(file), f"minerva info {file} --string lists the agents and their attributes")
    agent, attribute = question.agent.removeprefix("#"), question.attribute
    with Record(file) as record:
        explanation = explained_in(record, question.source, agent, attribute, question.frame)
    print_answer(explanation, as_json)
