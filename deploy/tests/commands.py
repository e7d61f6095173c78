"""The `minerva` commands in the files of deploy/, and the options that `minerva` accepts."""

import re
import shlex
from pathlib import Path

import typer.main

from minerva_bus.cli.main import app
from minerva_bus.entry_points import entries
from minerva_bus.launch.installed import WORLDS, find_world
from minerva_bus.launch.specs import find_service
from minerva_bus.launch.world_files import read_world_file

DEPLOY = Path(__file__).parents[1]


def known(words):
    """Options of a `minerva` command, whether it accepts others, and the remaining words."""
    group = typer.main.get_command(app)
    assert words[0] in group.commands, f"there is no minerva {words[0]}"
    command, rest = group.commands[words[0]], words[1:]
    if hasattr(command, "commands"):
        assert rest[0] in command.commands, f"there is no minerva {words[0]} {rest[0]}"
        command, rest = command.commands[rest[0]], rest[1:]
    options = {opt for param in command.params for opt in param.opts if opt.startswith("--")}
    return options, "ignore_unknown_options" in command.context_settings, rest


def own_options(spec):
    """Options of a world or a service."""
    if spec in entries(WORLDS):
        options = read_world_file(find_world(spec)).options
    else:
        options = find_service(spec).__init__.__annotations__
    return {f"--{option.replace('_', '-')}" for option in options}


def wrong_with(words):
    """Unknown options in a `minerva` command line, sorted."""
    options, open_, rest = known(words)
    given = {word.partition("=")[0] for word in rest if word.startswith("--")}
    left = given - options
    if left and open_ and not rest[0].startswith(("-", "$", "/")):
        left -= own_options(rest[0])
    return sorted(left)


def in_markdown(text):
    """The `minerva` command lines in the shell blocks of a page, as lists of words."""
    for block in re.findall(r"^```sh\n(.*?)^```", text, re.S | re.M):
        plain = re.sub(r"<<'END'.*?^END$", "", block, flags=re.S | re.M)
        for line in re.split(r"\n|;|&&", plain):
            plain = re.sub(r"\$\([^)]*\)", "x", line.strip().removeprefix("do "))
            words = shlex.split(plain.partition(" | ")[0])
            if words and words[0] == "minerva":
                yield words[1:]
