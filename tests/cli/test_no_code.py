"""Commands that inspect files of others can do so without running their code."""

import json
import subprocess
import sys

import pytest

CODE = """\
from pathlib import Path

from minerva_bus import Agent, EventType, Generator, Vocabulary, on

Path("ran").touch()
eStep = EventType("eStep")


class Walker(Agent, symbol="AWalker"):
    x: float = 0.0

    @on("eStep")
    def walk(self, step, moment):
        self.x += 1.0


class Steps(Generator):
    def generates(self):
        return ("eStep",)

    def generate(self, tick):
        yield eStep()


vocabulary = Vocabulary.of(eStep, Walker)
"""
FILE = """\
[options]
start = 2

[world]
string = "AWalker#w<x=${start}>"
vocabulary = "trail:vocabulary"
order = ["eStep"]
frames = 3

[process.walkers]
agents = "trail:Walker"

[process.steps]
service = "trail:Steps"
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "trail.py").write_text(CODE)
    (tmp_path / "trail.toml").write_text(FILE)
    return tmp_path


def minerva(folder, *words):
    command = [sys.executable, "-m", "minerva_bus", *words]
    return subprocess.run(command, capture_output=True, text=True, cwd=folder, check=False)


def ran(folder):
    """Whether the file's module was imported since the last call."""
    mark = folder / "ran"
    there = mark.exists()
    mark.unlink(missing_ok=True)
    return there


def test_a_world_file_is_checked_without_its_code(folder):
    done = minerva(folder, "check", "trail.toml", "--no-code")
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == [
        "trail.toml: a world with 2 processes and 1 symbol; no code was run",
        "  not run: trail:vocabulary",
        "  not run: trail:Walker",
        "  not run: trail:Steps",
    ]
    said = json.loads(minerva(folder, "check", "trail.toml", "--no-code", "--json").stdout)
    assert said["code"] == ["trail:vocabulary", "trail:Walker", "trail:Steps"]
    assert not ran(folder)
    assert minerva(folder, "check", "trail.toml").returncode == 0
    assert ran(folder)


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("[process.steps]", "[proces.steps]", "is unknown; did you mean 'process'?"),
        ("AWalker#w<x=${start}>", "AWalker#w<x=", "expected"),
        ("[options]", "[options", "Expected ']'"),
    ],
)
def test_errors_are_reported_without_running_code(old, new, complaint, folder):
    (folder / "trail.toml").write_text(FILE.replace(old, new))
    done = minerva(folder, "check", "trail.toml", "--no-code")
    assert done.returncode == 1
    assert complaint in done.stderr
    assert not ran(folder)


def test_a_record_is_shown_without_its_code(folder):
    pytest.importorskip("mcap", reason="pip install 'minerva-bus[record]'")
    run = minerva(folder, "run", "trail.toml", "--in-process", "--rate", "0", "--record", "r.mcap")
    assert run.returncode == 0, run.stderr
    assert ran(folder)
    done = minerva(folder, "replay", "r.mcap", "--no-code", "--from", "1")
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert [line for line in lines if "frame" in line] == [
        "frame 1, until 0.20 s: 1 AWalker",
        "frame 2, until 0.30 s: 1 AWalker",
    ]
    assert "    eStep" in lines
    plain = [json.loads(line) for line in
             minerva(folder, "replay", "r.mcap", "--no-code", "--json").stdout.splitlines()]  # fmt: skip
    assert [row["string"] for row in plain] == [f"AWalker#w<x={x}>()" for x in (3, 4, 5)]
    for words in (("info", "r.mcap"), ("info", "r.mcap", "--frame", "1"), ("recover", "r.mcap"),
                  ("diff", "r.mcap", "r.mcap"), ("plot", "r.mcap")):  # fmt: skip
        assert minerva(folder, *words).returncode == 0, words
    assert not ran(folder)
    assert minerva(folder, "replay", "r.mcap", "--recompute").returncode == 0
    assert ran(folder)


def test_a_check_that_needs_code_is_rejected(folder):
    for words in (("--recompute",), ("--view", "svg")):
        done = minerva(folder, "replay", "r.mcap", "--no-code", *words)
        assert done.returncode == 2
        assert "runs code" in done.stderr
    done = minerva(folder, "check", "trail.toml", "--no-code", "--vocabulary", "trail:vocabulary")
    assert done.returncode == 2
    assert not ran(folder)


def test_the_help_warns_that_code_is_run(folder):
    for command in ("check", "replay"):
        said = " ".join(minerva(folder, command, "--help").stdout.split())
        assert "This runs the Python code" in said
        assert "--no-code" in said
