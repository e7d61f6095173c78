"""The commands in the files of deploy/ for shells, containers and units exist."""

import re

import pytest

from deploy.tests.commands import in_markdown, wrong_with
from deploy.tests.deployed import COMPOSE, CONTAINERS, FLEET, README, UNITS
from minerva_bus.entry_points import entries
from minerva_bus.launch.installed import WORLDS, find_world
from minerva_bus.launch.world_files import read_world_file


def commands():
    yield from in_markdown(README)
    yield from in_markdown(FLEET)
    for name, service in COMPOSE["services"].items():
        if service["image"].startswith("minerva-bus:"):
            yield [*service["command"], f"#{name}"]
    for container in CONTAINERS:
        if "command" not in container:
            yield container["args"]
    for unit in UNITS:
        (line,) = re.findall(r"^ExecStart=/opt/minerva/bin/minerva (.*)$", unit.read_text(), re.M)
        yield line.split()
    for args in re.findall(r"^.*MINERVA_ARGS=(--listen.*?)'? >", README, re.M):
        yield ["run", *args.split()]


@pytest.mark.parametrize("words", list(commands()), ids=" ".join)
def test_every_command_is_one_that_minerva_knows(words):
    assert wrong_with([word for word in words if not word.startswith("#")]) == []


def test_there_are_commands_to_look_at():
    first = [words[0] for words in commands()]
    assert set(first) >= {"run", "attach", "keys", "list", "top"}
    assert len(first) > 25


def test_members_are_the_processes_of_the_world():
    file = read_world_file(find_world("robot"))
    assert "robot" in entries(WORLDS)
    names = {process.name for process in file.processes}
    attached = {
        name
        for name, container in COMPOSE["services"].items()
        if "attach" in container.get("command", ())
    }
    assert attached == names
    issued = set(re.findall(r"keys issue (\w+)", README)) | set(
        re.search(r"for name in ([\w ]+); do", README)[1].split()
    )
    assert names <= issued
