"""Bad input of any kind gives one clear message and an exit code, no traceback or hang."""

import json
import os
import socket
import subprocess
import sys

import pytest

WORDS = """
from minerva_bus import *

PDot = Primitive("PDot")
TMove = Transformation("TMove", dist=Metres)
eStep = EventType("eStep")

class Walker(Agent, symbol="AWalker"):
    x: Metres = 0.0

    @on("eStep")
    def walk(self, step, moment):
        self.x += 1

vocabulary = Vocabulary.of(PDot, TMove, eStep, Walker)
"""

WORLD = """
[world]
string = "PDot · AWalker#w"
vocabulary = "words:vocabulary"
frames = 5

[process.walkers]
agents = "words:Walker"

[process.steps]
service = "each"
event = "eStep"
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "words.py").write_text(WORDS, encoding="utf-8")
    (tmp_path / "world.toml").write_text(WORLD, encoding="utf-8")
    return tmp_path


def minerva(folder, *words):
    done = subprocess.run(
        [sys.executable, "-m", "minerva_bus.cli.main", *words],
        cwd=folder,
        capture_output=True,
        text=True,
        env={**os.environ, "MINERVA_RUNTIME_DIR": str(folder / "run")},
    )
    assert "Traceback" not in done.stderr + done.stdout, done.stderr
    return done


def changed(folder, old, new, name="changed.toml"):
    text = (folder / "world.toml").read_text(encoding="utf-8")
    assert old in text
    (folder / name).write_text(text.replace(old, new), encoding="utf-8")
    return name


def test_the_world_itself_is_right(folder):
    assert minerva(folder, "check", "world.toml").returncode == 0
    answer = json.loads(minerva(folder, "run", "world.toml", "--json").stdout)
    assert answer["frames"] == 5
    assert answer["members"] == 2


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("frames = 5", "frams = 5", "world.frams is unknown; did you mean 'frames'?"),
        ("frames = 5", 'frames = "many"', "world.frames must be a whole number"),
        ("frames = 5", "frames = -1", "world.frames must be at least 0"),
        ("frames = 5", f"frames = {10**40}", "world.frames must be at most 9223372036854775807"),
        ("frames = 5", "frames = ", ":5:10: not TOML: Invalid value; expected "),
        ("AWalker#w", "AWolker#w", "did you mean 'AWalker'?"),
        ("AWalker#w", "AWalker#w<y=1>", "AWalker#w has no y"),
        ("AWalker#w", "AWalker#w<x=1s>", "x must be a number in m"),
        ("AWalker#w", "TMove<dist=1>(AWalker#w", "the scope of TMove is not closed"),
        (
            "words:vocabulary",
            "wards:vocabulary",
            "world.vocabulary: 'wards:vocabulary': there is no mod",
        ),
        ("words:vocabulary", "words:vocabular", "world.vocabulary: words has no vocabular"),
        ('service = "each"', 'service = "eech"', ".service: no service 'eech' is installed; did"),
        ('"words:Walker"', '"words:Wolker"', "process.walkers.agents: words has no Wolker; did"),
        ("[world]", "[wrold]", ":2: wrold is unknown; did you mean 'world'?"),
        ('event = "eStep"', 'evnt = "eStep"', "did you mean 'event'?"),
        ('event = "eStep"', 'event = "eStop"', "eStop"),
        ('agents = "words:Walker"', "", "needs exactly one of service, agents and command"),
        (
            'agents = "words:Walker"',
            'command = ["no-such-program"]',
            "which is not an executable file",
        ),
        ("[process.walkers]", "[process.coordinator]", "the process name coordinator is reserved"),
        ("[process.walkers]", "[process.people]", "the process name people is reserved: norms"),
        ("[process.walkers]", '[bus]\nlisten = "here"\n[process.walkers]', "is not an endpoint"),
    ],
)
def test_a_wrong_world_file(folder, old, new, message):
    name = changed(folder, old, new)
    checked = minerva(folder, "check", name)
    assert checked.returncode == 1
    assert message in checked.stderr
    run = minerva(folder, "run", name)
    assert run.returncode == 2
    assert message in run.stderr


def test_an_error_in_a_string_has_line_column_and_caret(folder):
    (folder / "cut.mnv").write_text("PDot\n · TMove<dist=>(PDot)\n", encoding="utf-8")
    done = minerva(folder, "check", "cut.mnv")
    assert done.returncode == 1
    first, shown, caret = done.stderr.rstrip("\n").split("\n")
    assert first.startswith("cut.mnv:2:15: found '>'; expected a number")
    assert shown[caret.index("^")] == ">"


def test_symbols_are_checked_with_a_vocabulary(folder):
    (folder / "scene.mnv").write_text("PDot · PDat", encoding="utf-8")
    assert minerva(folder, "check", "scene.mnv").returncode == 0
    words = ("check", "scene.mnv", "--vocabulary", "words:vocabulary")
    done = minerva(folder, *words)
    assert done.returncode == 1
    assert "did you mean 'PDot'?" in done.stderr
    answer = json.loads(minerva(folder, *words, "--json").stdout)
    assert answer["ok"] is False
    assert (answer["line"], answer["column"]) == (1, 8)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("run", "nowhere.toml"), "there is no world file nowhere.toml"),
        (("run", ".."), ".. is a folder; give the world file in it, ../NAME.toml"),
        (("run", "./"), "./ is a folder; give the world file in it, ./NAME.toml"),
        (("run", "robt"), "did you mean 'robot'?"),
        (("run", "robot", "--objectiv", "x"), "did you mean '--objective'?"),
        (("run", "robot", "--objective", "kichen"), "did you mean 'kitchen'?"),
        (("run", "robot", "--robots", "many"), "--robots must be a whole number"),
        (("run", "robot", "--planner", "dijkstra"), "astar"),
        (("run", "robot", "--map", "nowhere.yaml"), "nowhere.yaml"),
        (("run", "robot", "--set", "physics.beems=3"), "did you mean 'beams'?"),
        (("run", "robot", "--view", "swg"), "did you mean 'svg'?"),
        (("run", "world.toml", "--rate", "-1"), "--rate must be"),
        (("list", "--world", "none"), "no world 'none' runs on this machine"),
        (("pub", "eStep", "x"), "expected data as KEY=VALUE"),
        (("attach", "words:Walker"), "no world runs on this machine"),
        (
            ("attach", "terminal"),
            "no service 'terminal' is installed; there are the views foxglove,",
        ),
        (("attach", "meadow"), "no service 'meadow' is installed; meadow is a world: minerva run"),
        (("run", "svg"), "no world 'svg'; svg takes part in a running world: minerva attach svg"),
        (
            ("run", "world.toml", "--view", "terminal"),
            "no view 'terminal' is installed; there are foxglove, opengl, page, rerun, ros2_view, sound, sprites, svg, web",
        ),
        (
            ("run", "world.toml", "--view", "sprite"),
            "no view 'sprite' is installed; did you mean 'sprites'?",
        ),
        (("attach", "words:Walker", "--connect", "nonsense", "--world", "w"), "is not an endpoint"),
        (("attach", "words:Walker", "--connect", "tcp/127.0.0.1:9", "--world", "w"), "no answer"),
    ],
)
def test_a_wrong_command_line(folder, words, message):
    done = minerva(folder, *words)
    assert done.returncode == 2
    assert message in done.stderr


@pytest.mark.parametrize(
    "data",
    [
        b"P5\n10 10\n255\n\x00\x00",
        b"P5\n-3 10\n255\n",
        b"GIF89a",
        b"",
        b"P5\n99999999 99999999\n255\n",
    ],
)
def test_a_corrupt_map(folder, data):
    (folder / "map.pgm").write_bytes(data)
    (folder / "map.yaml").write_text(
        '{"image": "map.pgm", "resolution": 0.05, "origin": [0, 0, 0], "negate": 0,'
        ' "occupied_thresh": 0.65, "free_thresh": 0.2}',
        encoding="utf-8",
    )
    done = minerva(folder, "run", "robot", "--map", "map.yaml")
    assert done.returncode == 2
    assert "map.pgm" in done.stderr


def test_a_port_in_use(folder):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        endpoint = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        done = minerva(folder, "run", "world.toml", "--listen", endpoint)
    assert done.returncode == 1
    assert done.stderr.count(f"cannot listen at {endpoint}") == 1
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.parametrize("options", [(), ("--in-process",)])
def test_an_error_in_a_method_is_reported_once_in_ten_lines(folder, options):
    words = (folder / "words.py").read_text(encoding="utf-8")
    (folder / "words.py").write_text(words.replace("self.x += 1", "self.x += wheels"))
    done = minerva(folder, "run", "world.toml", *options)
    assert done.returncode == 1
    assert done.stderr.count("NameError") == 1
    assert "NameError" not in done.stdout
    assert "words.py:" in done.stderr
    assert " is gone" not in done.stderr
    assert len([line for line in done.stderr.splitlines() if "walkers" in line]) <= 10


def test_versions_and_help(folder):
    from minerva_bus.frame.messages import PROTOCOL_VERSION

    answer = json.loads(minerva(folder, "version", "--json").stdout)
    assert answer["protocol"] == PROTOCOL_VERSION
    shown = minerva(folder, "--help")
    for command in ("run", "check", "attach", "list", "echo", "pub", "version"):
        assert f" {command} " in shown.stdout


@pytest.mark.parametrize(
    "words",
    [
        ("run", "x" * 300),
        ("run", "world.toml", "--label", "x" * 300),
        ("check", "x" * 300),
        ("info", f"{'x' * 300}.mcap"),
        ("diff", "x" * 300, "y"),
        ("map", "x" * 300),
    ],
    ids=lambda words: words[0],
)
def test_a_name_that_is_too_long_for_a_file_is_no_failure(folder, words):
    path = folder / "world.toml"
    path.write_text(WORLD + '[options]\nlabel = "short"\n', encoding="utf-8")
    done = minerva(folder, *words, *(("--in-process",) if "--label" in words else ()))
    assert done.returncode == (0 if "--label" in words else 2), done.stderr
    assert len(done.stderr.splitlines()) <= 10


def test_a_command_is_searched_where_it_runs(folder):
    tool = folder / "tool"
    tool.write_text("#!/bin/sh\nexit 0\n", encoding="utf-8")
    tool.chmod(0o755)
    for command, code in (("./tool", 0), ("tool", 1), ("./other", 1), ("sh", 0)):
        text = WORLD.replace('agents = "words:Walker"', f'command = ["{command}"]')
        (folder / "world.toml").write_text(text, encoding="utf-8")
        # The command also works from another folder: it runs in the folder of the world file.
        (folder / "elsewhere").mkdir(exist_ok=True)
        done = minerva(folder / "elsewhere", "check", "../world.toml")
        assert (done.returncode, "not an executable" in done.stderr) == (code, bool(code)), command
