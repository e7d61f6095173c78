"""`minerva explain`: the causes of a value in a record, and of a world that does not advance."""

from __future__ import annotations

from pathlib import Path

from minerva_bus.api.records import explain
from minerva_bus.cli.options import WorldTarget
from minerva_bus.cli.output import print_answer
from minerva_bus.cli.places import client
from minerva_bus.errors import MisuseError
from minerva_bus.launch.explaining import explain_world


def explain_running(target: WorldTarget, as_json: bool) -> None:
    """Print why a running world does not advance. Raises BusError."""
    with client(target) as world:
        print_answer(explain_world(world.operator), as_json)


def explain_record(
    file: Path, world: str, agent: str, attribute: str, frame: int | None, as_json: bool
) -> None:
    """Print how an attribute got its value. Raises RecordError and WorldFileError."""
    for option, given in (("--agent ID", agent), ("--attribute NAME", attribute)):
        if not given:
            hint = f"minerva info {file} --string lists the agents and their attributes"
            raise MisuseError(f"explain {file}: {option} is missing; {hint}")
    print_answer(explain(file, agent, attribute, frame, world), as_json)
