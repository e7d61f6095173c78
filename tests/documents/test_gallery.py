"""Each command of the gallery can be typed, and its world runs for some frames."""

import re
import shlex
from importlib.metadata import entry_points
from typing import Any

import pytest
import typer
from pages import ROOT

from minerva_bus import World, run, user_code
from minerva_bus.cli.main import app
from minerva_bus.launch.installed import declared_options
from minerva_bus.launch.world_files import idle

TEXT = (ROOT / "docs" / "gallery" / "index.md").read_text(encoding="utf-8")
COMMANDS = re.findall(r"^`minerva run (.+)`$", TEXT, re.M)
SCRIPTS = re.findall(r"^`python (\S+)`$", TEXT, re.M)
MAP = ROOT / "agents" / "minerva_agents" / "robot" / "plan" / "office.yaml"
CONNECTED = {"house": "a broker", "ros2": "a robot"}
"""Worlds that need something else to run; they are read only."""


def typed(command: str) -> tuple[str, list[str], dict[str, Any]]:
    """The world of a command, its views, and the options of the world."""
    program: Any = typer.main.get_command(app)
    name, *rest = shlex.split(command)
    declared = program.commands["run"]
    context = declared.make_context("run", [name, *rest])
    assert context.params["world"] == name
    words = list(context.args)
    options = {
        key.removeprefix("--"): text for key, text in zip(words[::2], words[1::2], strict=True)
    }
    return name, list(context.params["view"] or ()), options


def test_the_gallery_has_a_command_for_each_world_and_example():
    worlds = {each.name for each in entry_points(group="minerva.worlds")}
    assert {command.split()[0] for command in COMMANDS} == worlds
    assert all((ROOT / script).is_file() for script in SCRIPTS)
    assert len(SCRIPTS) == 1
    # The number of lines is counted when the site is built.
    assert TEXT.count("{lines}`") == TEXT.count("{grid-item-card}")
    assert not re.search(r"\d lines of", TEXT)


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_has_installed_views_and_options_of_its_world(command):
    name, views, options = typed(command)
    services = {each.name for each in entry_points(group="minerva.services")}
    assert {view.partition(":")[0] for view in views} <= services
    assert set(options) <= {option.name for option in declared_options(name)}


@pytest.mark.parametrize("command", COMMANDS)
def test_the_world_of_a_command_runs(command, monkeypatch):
    # A start does not parse the project's own code.
    monkeypatch.setattr(user_code, "_SHIPPED", ())
    idle.cache_clear()
    name, _, options = typed(command)
    if "map" in options:
        assert options["map"] == MAP.name
        options["map"] = str(MAP)
    world = World.load(name, **options)
    assert not [line for line in world.read().warnings if "has no effect" in line]
    if name not in CONNECTED:
        assert run(world, frames=2, rate=0).frames == 2
