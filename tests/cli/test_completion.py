"""Completion by the protocol of shells, and in a real bash."""

import os
import pty
import re
import select
import shlex
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.patience import eventually
from tests.runtime.running import MEMBERS, World, environment, write_world

HERE = Path(sys.executable).parent
MINERVA = [sys.executable, HERE / "minerva"]


def asked(folder, shell, words, *python):
    """The process that answers a shell; `words` is the line up to the cursor."""
    line = {"_TYPER_COMPLETE_ARGS": words, "_TYPER_COMPLETE_FISH_ACTION": "get-args"}
    if shell == "bash":
        parts = words.split(" ")
        line = {"COMP_WORDS": "\n".join(parts), "COMP_CWORD": str(len(parts) - 1)}
    return subprocess.run(
        [sys.executable, *python, HERE / "minerva"], cwd=folder, capture_output=True, text=True,
        env={**environment(folder), "_MINERVA_COMPLETE": f"complete_{shell}", **line},
    )  # fmt: skip


def completed(folder, words, shell="fish"):
    """The completions of a line."""
    done = asked(folder, shell, f"minerva {words}")
    assert "Traceback" not in done.stderr + done.stdout
    assert done.stderr == ""
    return [line.partition("\t")[0] for line in done.stdout.splitlines() if line]


@pytest.fixture
def files(tmp_path):
    for name in (
        "a.toml",
        "b.mcap",
        "c.mnv",
        "notes.txt",
        "t.csv",
        "deep/only/d.toml",
        ".hidden.toml",
    ):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("")
    (tmp_path / "a.toml").write_text(
        '[world]\nstring = ""\n[options]\nspeed = 1.0 # metres per second\n[process.p]\n'
        'service = "carmen"\nspeed = 2\n[process.q]\nagents = "m:A"\nrestarts = 3\n'
    )
    return tmp_path


@pytest.mark.parametrize(
    ("words", "expected", "others"),
    [
        ("gr", ["graph"], ["run"]),
        ("run ", ["robot", "meadow", "a.toml", "deep/"], ["b.mcap", "notes.txt", ".hidden.toml"]),
        ("graph me", ["meadow"], ["robot"]),
        ("run deep/o", ["deep/only/d.toml"], []),
        ("run robot --ro", ["--robots"], ["--planner"]),
        ("run robot --planner ", ["astar", "random"], ["a.toml"]),
        ("graph robot --localise m", ["matching"], ["odometry"]),
        ("attach svg --path de", ["deep/only/d.toml"], []),
        ("attach svg --png ", ["true", "false"], ["a.toml"]),
        ("attach svg --every ", [], ["a.toml"]),
        ("attach --process planner robot --planner ", ["astar", "random"], []),
        ("run traffic --norms ", ["true", "false"], []),
        ("run robot --map ", ["a.toml", "notes.txt", "deep/"], []),
        ("run a.toml --speed ", [], ["a.toml", "true"]),
        ("run robot --planner astar ", [], ["astar", "random"]),
        ("run a.toml --nothing ", [], ["a.toml"]),
        ("graph a.toml --", ["--speed", "--output", "--json"], ["--robots"]),
        ("run robot --view s", ["svg", "sprites", "sound"], ["carmen", "physics"]),
        ("bridge r", ["rplidar", "rosbag"], ["robot", "svg"]),
        ("bridge carmen x.log --sp", ["--speed"], []),
        ("attach sv", ["svg"], []),
        ("attach svg --ev", ["--every"], []),
        ("attach --process p --wo", ["--world"], []),
        ("replay ", ["b.mcap"], ["a.toml"]),
        ("run --resume ", ["b.mcap"], ["a.toml"]),
        ("run a.toml --into ", ["t.csv"], ["b.mcap", "notes.txt"]),
        ("check ", ["c.mnv", "a.toml"], ["b.mcap"]),
        ("new world mine --from me", ["meadow"], []),
        ("keys re", ["revoke"], []),
    ],
)  # fmt: skip
def test_a_line_is_completed(files, words, expected, others):
    completions = completed(files, words)
    assert set(expected) <= set(completions)
    assert not set(others) & set(completions)


def test_each_shell_gets_its_format(files):
    zsh = asked(files, "zsh", "minerva run rob").stdout
    assert zsh.startswith('_arguments \'*: :(("robot":"A robot finds a room')
    fish = asked(files, "fish", "minerva run rob").stdout.splitlines()
    assert fish[0].startswith("robot\tA robot finds a room")
    assert completed(files, "run rob", "bash") == ["robot", "robots"]


@pytest.mark.parametrize(
    "words",
    [
        "run nothing --", "run nothing --collect n=", "sweep nothing --set ", "replay no/such/folder/",
        "pub ", "pub eRain ", "logs ", "run robot --view nothing:", "replay b.mcap --",
        "attach nothing --", "run 'rob", "logs --connect tcp/127.0.0.1:9 ",
    ],
)  # fmt: skip
def test_what_cannot_be_completed_is_answered_with_nothing_else(files, words):
    for shell in ("bash", "zsh", "fish"):
        done = asked(files, shell, f"minerva {words}")
        assert done.stderr == ""
        assert "Traceback" not in done.stdout


@pytest.mark.parametrize(
    "words", ["gr", "run ro", "run robot --ro", "run robot --view s", "sweep robot --f",
              "bridge r", "keys i", "replay ", "logs --world "],
)  # fmt: skip
def test_static_completions_import_nothing_heavy(files, words):
    done = asked(files, "zsh", f"minerva {words}", "-X", "importtime")
    modules = {
        line.rpartition("|")[2].strip().partition(".")[0] for line in done.stderr.splitlines()
    }
    assert "typer" in modules
    assert not modules & {"numpy", "zenoh", "msgpack", "pydantic", "rich", "pygame", "mcap"}


def test_a_running_world_completes_its_names(tmp_path):
    path = write_world(tmp_path, MEMBERS, frames=0, rate=20)
    with World(path) as world:
        world.runs("steps", "walkers")
        assert completed(tmp_path, "stop ") == [world.name]
        assert completed(tmp_path, "top --world ") == [world.name]
        assert {"steps", "walkers"} <= set(completed(tmp_path, "logs "))
        assert {"steps", "walkers"} <= set(completed(tmp_path, "drain "))
        assert {"eWish", "eStep"} <= set(completed(tmp_path, "pub "))
        assert completed(tmp_path, "echo AW") == ["AWalker"]
        assert completed(tmp_path, f"pub --world {world.name} eWi") == ["eWish"]
        assert completed(tmp_path, f"pub {world.name} eWi") == ["eWish"]
        # A world that does not answer does not block the shell.
        pid = world.coordinator()
        os.kill(pid, signal.SIGSTOP)
        asked(tmp_path, "fish", "minerva logs ")
        os.kill(pid, signal.SIGCONT)


class Bash:
    """bash in a terminal, with the completion of `minerva`."""

    def __init__(self, folder):
        self._folder = folder
        self.text = ""

    def __enter__(self):
        given = {
            **environment(self._folder),
            "PATH": f"{HERE}:{os.environ['PATH']}",
            "TERM": "dumb",
        }
        self._terminal, other = pty.openpty()
        self._process = subprocess.Popen(
            ["bash", "--norc", "--noprofile", "-i"], cwd=self._folder, env={**given, "PS1": "$ "},
            stdin=other, stdout=other, stderr=other, start_new_session=True,
        )  # fmt: skip
        os.close(other)
        self.types('eval "$(_MINERVA_COMPLETE=source_bash minerva)"\r')
        # Completion runs the program; Enter prints the words that it would get.
        self.types('minerva() { printf \'<%s>\' "$@"; echo; }; echo lo""aded\r')
        self.shows("loaded")
        return self

    def __exit__(self, *_):
        self._process.kill()
        self._process.wait()
        os.close(self._terminal)

    def types(self, text):
        os.write(self._terminal, text.encode())

    def shows(self, text):
        def shown():
            if select.select([self._terminal], [], [], 0.1)[0]:
                read = os.read(self._terminal, 4096).decode(errors="replace")
                self.text += read.replace("\a", "")  # It rings for a choice of several.
            return text in self.text

        eventually(shown, lambda: self.text)

    def words(self, typed, shown):
        """The arguments of a line after `typed` and Tab, when `shown` appears."""
        self.text = ""
        self.types(f"minerva {typed}\t")
        self.shows(shown)
        self.types("\r")
        self.shows(">\r\n")
        return re.findall("<(.*?)>", self.text)


def test_in_a_real_bash_tab_completes_words(files):
    with Bash(files) as bash:
        assert bash.words("bridge rpl", "rplidar") == ["bridge", "rplidar"]
        assert bash.words("run deep/o", "d.toml") == ["run", "deep/only/d.toml"]
        assert bash.words("run robot --planner a", "astar")[-1] == "astar"


def test_the_script_of_each_shell_is_printed(tmp_path):
    for shell in ("bash", "zsh", "fish"):
        done = subprocess.run(
            MINERVA, env={**environment(tmp_path), "_MINERVA_COMPLETE": f"source_{shell}"},
            capture_output=True, text=True,
        )  # fmt: skip
        assert "_MINERVA_COMPLETE=complete_" in done.stdout
    # Typer searches the shell among the processes that have started it.
    line = f"{shlex.join(map(str, MINERVA))} --show-completion; exit $?"
    shown = subprocess.run(["bash", "-c", line], env=environment(tmp_path), capture_output=True)
    assert b"_MINERVA_COMPLETE=complete_bash" in shown.stdout
