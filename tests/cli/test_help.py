"""`minerva --help` and `minerva COMMAND --help`: groups, summaries and examples."""

import ast
import inspect
import json
import re
import shlex
from pathlib import Path

import pytest
import typer.main

from minerva_bus.cli.main import app, command_of, main, topics
from minerva_bus.cli.options import examples_of
from minerva_bus.errors import MisuseError, UnknownOption

ROOT = typer.main.get_group(app)
REPOSITORY = Path(__file__).parents[2]
NAMES = [name for group in topics().values() for name in group]
EXAMPLES = [line for name in NAMES if name != "keys" for line in examples_of(command_of(name))]


def help_of(capsys, *words, all_options=False):
    with pytest.raises(SystemExit) as ended:
        app([*words, "--help-all" if all_options else "--help"])
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
    examples = examples_of(command_of(name))
    assert len(examples) >= 2
    shown = help_of(capsys, name).splitlines()
    assert {f"    {line}" for line in examples} <= set(shown)
    assert all(line.split()[1] == name for line in examples)


@pytest.mark.parametrize("line", EXAMPLES)
def test_the_options_of_examples_exist(line, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = shlex.split(line.partition(" > ")[0])
    ROOT.commands[words[1]].make_context(words[1], words[2:])


def texts_of(path):
    """The strings of a module; what an f-string inserts is a null character."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.JoinedStr):
            yield "".join(getattr(part, "value", "") if isinstance(part, ast.Constant) else "\0"
                          for part in node.values)  # fmt: skip
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value


def options_of_command(command):
    """The options of a command, and of its commands if it is a group."""
    own = {word for each in command.params for word in (*each.opts, *each.secondary_opts)}
    return own.union(*map(options_of_command, getattr(command, "commands", {}).values()))


def untypable(text):
    """Commands, and options of commands, that a text names and the command line lacks."""
    for name, rest in re.findall(r"\bminerva ([a-z]+)([^`;,:\n]*)", text):
        command = ROOT.commands.get(name)
        words = re.findall(r"(?<![\w-])--[a-z][\w-]*", rest.partition(" -- ")[0])
        if command is None and words:
            yield name
        if command is not None and not command.context_settings.get("ignore_unknown_options"):
            known = options_of_command(command) | {"--help", "--help-all"}
            yield from [f"{name} {word}" for word in words if word not in known]


MODULES = [path for path in sorted(REPOSITORY.rglob("*.py"))
           if re.match(r"(minerva_bus|services|agents|worlds|extensions)/",
                       path.relative_to(REPOSITORY).as_posix())
           and not {"tests", "build", "benchmarks"} & {*path.parts}]  # fmt: skip


def test_commands_of_messages_and_docstrings_can_be_typed():
    wrong = {path: [*found] for path in MODULES for text in texts_of(path)
             if (found := [*untypable(text)])}  # fmt: skip
    assert wrong == {}
    assert [*untypable("see minerva lst --json, and minerva list --jsn")] == ["lst", "list --jsn"]


@pytest.mark.parametrize("name", [name for name in NAMES if name != "keys"])
def test_a_command_uses_the_options_that_it_does_not_refuse(name):
    if ROOT.commands[name].context_settings.get("ignore_unknown_options"):
        assert "context.args" in inspect.getsource(command_of(name))


@pytest.mark.parametrize("words", [("--recomput",), ("robot", "--recomput"), ("robot", "more")])
def test_a_replay_refuses_what_it_does_not_know(words):
    with pytest.raises(MisuseError, match=words[-1]):
        app(["replay", "run.mcap", *words])


def test_the_help_of_run_begins_with_the_usual_options(capsys):
    short, whole = help_of(capsys, "run"), help_of(capsys, "run", all_options=True)
    assert ("--seed <whole number>" in short, "--log-format" in short) == (True, False)
    assert "--log-format <text>" in whole
    assert "--log-format" in {flag for each in ROOT.commands["run"].params for flag in each.opts}


def test_the_help_of_a_world_lists_its_options(capsys, tmp_path):
    world = tmp_path / "yard.toml"
    world.write_text(
        '[options]\nbirds = 300  # number of birds\nsign = "#"  # a text, such as "#"\nplain = true\n'
    )
    shown = help_of(capsys, "run", str(world))
    assert "--birds <whole number>   number of birds  [default: 300]" in shown
    assert '--sign <text>            a text, such as "#"  [default: "#"]' in shown
    assert "--plain <true or false>  [default: true]" in shown


def test_the_help_of_a_service_lists_its_options(capsys):
    shown = help_of(capsys, "bridge", "rplidar")
    assert "--baud <whole number>" in shown
    assert "[default: 115200]" in shown


@pytest.mark.parametrize("text", ["[options", "[options]\nx = 1 #", "\xff"])
def test_the_help_of_a_damaged_world_is_shown(capsys, tmp_path, text):
    world = tmp_path / "yard.toml"
    world.write_bytes(text.encode("latin-1"))
    assert "--seed" in help_of(capsys, "run", str(world))
    assert "there is no world" in help_of(capsys, "run", "nowhere")


def test_suggestions_consider_the_options_of_the_command(tmp_path):
    world = tmp_path / "yard.toml"
    world.write_text('[world]\nstring = ""\nvocabulary = "none:none"\n[options]\nbirds = 300\n')
    for word, meant in (("--frams", "--frames"), ("--bird", "--birds")):
        with pytest.raises(UnknownOption, match=f"no option {word}; did you mean '{meant}'"):
            app(["run", str(world), word, "3"])


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        (["attach", "svg", "--conect", "x"], "--connect"),
        (["attach", "svg", "--evry", "5"], "--every"),
        (["bridge", "carmen", "a.log", "--wrld", "y"], "--world"),
        (["graph", "robot", "--outpt", "a.svg"], "--output"),
        (["sweep", "robot", "--set", "seed=1", "--fams", "3"], "--frames"),
    ],
)
def test_a_misspelt_option_of_the_command_or_of_the_other_is_recognised(
    tmp_path, monkeypatch, capsys, words, meant
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["minerva", *words])
    with pytest.raises(SystemExit):
        main()
    assert f"did you mean '{meant}'?" in capsys.readouterr().err


def test_installed_worlds_are_listed(capsys):
    app(["worlds", "--json"], standalone_mode=False)
    assert json.loads(capsys.readouterr().out)["meadow"].startswith("Grass, rabbits and foxes")
