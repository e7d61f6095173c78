"""The name of a running world before the other arguments of a command."""

import pytest
import typer.main

from minerva_bus.cli.main import app
from minerva_bus.errors import MisuseError
from minerva_bus.launch import registry
from minerva_bus.launch.registry import RunningWorld

ROOT = typer.main.get_group(app)
OBSERVERS = ("list", "top", "logs", "echo", "metrics", "mcp")
CONTROLS = ("pub", "pause", "resume", "step", "rate", "restart", "drain", "stop", "seek")


@pytest.fixture
def worlds(monkeypatch):
    """Two worlds run here: garden, and 7."""
    entries = [RunningWorld(name, "tcp/127.0.0.1:1", 1) for name in ("7", "garden")]
    monkeypatch.setattr(registry, "running", lambda: entries)


def parsed(line):
    """The world and the other arguments that a command gets."""
    name, *words = line.split()
    command = ROOT.commands[name]
    values = command.make_context(name, words).params
    arguments = [each.name for each in command.params if each.param_type_name == "argument"]
    assert arguments[0] == "name"
    others = {key: values[key] for key in arguments[1:] if values[key]}
    return values["name"] or values["world"], others


@pytest.mark.parametrize("command", [*OBSERVERS, *CONTROLS])
def test_every_command_for_a_running_world_takes_its_name_first(command):
    arguments = [each for each in ROOT.commands[command].params if each.name == "name"]
    assert [each.param_type_name for each in arguments] == ["argument"]


@pytest.mark.parametrize(("line", "world", "others"), [
    ("stop garden", "garden", {}),
    ("stop nowhere", "nowhere", {}),
    ("pub eSun", "", {"type": "eSun"}),
    ("pub garden eSun", "garden", {"type": "eSun"}),
    ("pub nowhere eSun", "nowhere", {"type": "eSun"}),
    ("pub --as garden eSun", "", {"type": "eSun"}),
    ("pub garden eSun heat=2 to=1", "garden", {"type": "eSun", "data": ["heat=2", "to=1"]}),
    ("pub eSun heat=2 to=1", "", {"type": "eSun", "data": ["heat=2", "to=1"]}),
    ("pub eSun --world garden heat=2", "garden", {"type": "eSun", "data": ["heat=2"]}),
    ("pub eObjective kitchen", "", {"type": "eObjective", "data": ["kitchen"]}),
    ("pub garden esun", "garden", {"type": "esun"}),
    ("pub garden heat=2", "", {"type": "garden", "data": ["heat=2"]}),
    ("step", "", {"frames": 1}),
    ("step garden", "garden", {"frames": 1}),
    ("step garden 10", "garden", {"frames": 10}),
    ("step nowhere", "nowhere", {"frames": 1}),
    ("step 10 --world garden", "garden", {"frames": 10}),
    ("step 7", "", {"frames": 7}),
    ("step 7 10", "7", {"frames": 10}),
    ("rate garden 2.5", "garden", {"hz": 2.5}),
    ("rate 7", "", {"hz": 7.0}),
    ("seek garden 120", "garden", {"frame": 120}),
    ("restart garden", "", {"member": "garden"}),
    ("restart nowhere physics", "nowhere", {"member": "physics"}),
    ("drain garden hosts-1", "garden", {"member": "hosts-1"}),
    ("logs", "", {}),
    ("logs garden", "garden", {}),
    ("logs physics", "", {"member": "physics"}),
    ("logs garden garden", "garden", {"member": "garden"}),
    ("echo garden", "garden", {}),
    ("echo garden ASnail", "garden", {"type": "ASnail"}),
])  # fmt: skip
def test_the_first_word_is_the_world_if_it_is_not_the_first_argument(worlds, line, world, others):
    assert parsed(line) == (world, others)


def test_a_word_too_many_is_an_error(worlds):
    with pytest.raises(MisuseError, match=r"^step: .*unexpected extra argument.* \(2\)"):
        app(["step", "garden", "1", "2"])
