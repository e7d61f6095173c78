"""`minerva --help` and `minerva COMMAND --help`: groups, summaries and examples."""

import shlex
from importlib import import_module

import pytest
import typer.main

from minerva_bus.cli.main import GROUPS, app

ROOT = typer.main.get_group(app)
NAMES = [name for group in GROUPS.values() for name in group]
EXAMPLES = [
    line
    for name in NAMES
    if name != "keys"
    for line in import_module(f"minerva_bus.cli.commands.{name}").EXAMPLES
]


def help_of(capsys, *words):
    with pytest.raises(SystemExit) as ended:
        app([*words, "--help"])
    assert ended.value.code == 0
    return capsys.readouterr().out


def test_every_command_is_in_one_group():
    assert sorted(NAMES) == sorted(ROOT.commands)


def test_no_summary_is_cut_off(capsys):
    lines = help_of(capsys).splitlines()
    summaries = [line for line in lines if line.split() and line.split()[0] in NAMES]
    assert len(summaries) == len(NAMES)
    assert [line for line in summaries if line.endswith("...")] == []


@pytest.mark.parametrize("name", [name for name in NAMES if name != "keys"])
def test_every_command_shows_its_examples(capsys, name):
    examples = import_module(f"minerva_bus.cli.commands.{name}").EXAMPLES
    assert len(examples) >= 2
    shown = help_of(capsys, name).splitlines()
    assert {f"    {line}" for line in examples} <= set(shown)
    assert all(line.split()[1] == name for line in examples)


@pytest.mark.parametrize("line", EXAMPLES)
def test_the_options_of_examples_exist(line, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = shlex.split(line)
    ROOT.commands[words[1]].make_context(words[1], words[2:])
