"""Completion of agents, attributes and members of a record."""

import click
import pytest

from minerva_analysis.commands import completing
from minerva_bus import Agent, EventType, World, each, on, run

eTick = EventType("eTick")


class Snail(Agent, symbol="ASnail"):
    water: float = 3.0

    @on("eTick")
    def dry(self, tick, moment):
        self.water -= 0.1


class Stone(Agent, symbol="AStone"):
    size: int = 1


@pytest.fixture
def record(tmp_path):
    clock = {"clock": each(eTick)}
    world = World("ASnail#anna · AStone#s", agents={"snails": [Snail, Stone]}, services=clock)
    run(world, frames=2, record=tmp_path / "a.mcap", quiet=True)
    return str(tmp_path / "a.mcap")


@pytest.mark.parametrize(
    ("command", "complete", "params", "expected"),
    [
        ("explain", completing.agents, {}, ["anna", "s"]),
        ("explain", completing.attributes, {}, ["size", "water"]),
        ("explain", completing.attributes, {"agent": "anna"}, ["water"]),
        ("swap", completing.members, {}, ["clock=", "snails="]),
    ],
)
def test_what_a_record_has_completes_its_commands(record, command, complete, params, expected):
    context = click.Context(click.Command(command))
    context.params = {"record" if command == "explain" else "file": record, **params}
    assert [name for name, _ in complete(context, "")] == expected
