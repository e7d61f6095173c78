"""`minerva run --json` prints one summary on standard output, however the run ends."""

import json
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "runtime"))

from running import environment, here, minerva, write_world

KEYS = {
    "world", "frames", "frames_before", "digest", "reached", "wall_seconds", "frames_per_second",
    "first_frame_seconds", "startup_seconds", "members", "seed", "ended",
}  # fmt: skip


def only_summary(text):
    """The single JSON object on standard output."""
    (line,) = text.splitlines()
    answer = json.loads(line)
    assert set(answer) >= KEYS
    return answer


def test_a_world_whose_frames_are_over(tmp_path):
    done = here(tmp_path, "run", write_world(tmp_path, frames=2), "--in-process", "--json")
    assert (done.returncode, only_summary(done.stdout)["frames"]) == (0, 2)


@pytest.mark.parametrize(("words", "said"), [
    (["--nonsense"], "has no option --nonsense"),
    (["--seed", "x"], "Invalid value for '--seed'"),
    (["--rate", "-1"], "--rate"),
    (["--set", "there.is=1"], "there is no process"),
    (["--listen", "nowhere"], "nowhere"),
    (["--in-process", "--profile"], "omit --in-process"),
    (["--log-format", "xml"], "must be one of text, json"),
])  # fmt: skip
def test_invalid_options(tmp_path, words, said):
    done = here(tmp_path, "run", write_world(tmp_path, frames=2), "--json", *words)
    assert done.returncode == 2
    summary = only_summary(done.stdout)
    assert said in summary["ended"]
    assert (summary["frames"], summary["digest"]) == (0, None)


def test_an_unknown_world(tmp_path):
    done = here(tmp_path, "run", tmp_path / "none.toml", "--json")
    assert done.returncode == 2
    assert "none.toml" in only_summary(done.stdout)["ended"]


def test_a_missing_world_file(tmp_path):
    (tmp_path / "bad.toml").write_text("[world\n")
    done = here(tmp_path, "run", tmp_path / "bad.toml", "--log-format", "json")
    assert done.returncode == 2
    assert "bad.toml" in only_summary(done.stdout)["ended"]


def test_help_is_no_run(tmp_path):
    done = here(tmp_path, "run", "--json", "--help")
    assert done.returncode == 0
    assert "{" not in done.stdout


FAILING = """
from minerva_bus import Generator, Primitive, Vocabulary

vocabulary = Vocabulary.of(Primitive("PNothing"))


class FailsAtFrame(Generator):
    def generate(self, tick):
        if tick.frame.number == 2:
            raise ValueError("by design")


class Impostor(Generator, events=("eNone",)):
    def generate(self, tick):
        return iter(())
"""


def failing_world(folder, service, more=""):
    (folder / "failing.py").write_text(FAILING)
    path = folder / "failing.toml"
    path.write_text(
        '[world]\nstring = "PNothing"\nvocabulary = "failing:vocabulary"\n'
        f'[process.one]\nservice = "failing:{service}"\non_failure = "stop"\n{more}'
    )
    return path


@pytest.mark.parametrize("words", [(), ("--in-process",)])
def test_failing_members(tmp_path, words):
    """The summary has the frames before the failure, wherever the members run."""
    done = minerva(tmp_path, "run", failing_world(tmp_path, "FailsAtFrame"), "--json", *words)
    assert done.returncode == 1
    summary = only_summary(done.stdout)
    assert summary["ended"] == "one failed in frame 2: FailsAtFrame.generate: ValueError: by design"
    assert (summary["world"], summary["frames"], summary["seed"]) == ("failing", 2, 0)
    assert summary["first_frame_seconds"] > 0
    assert len(summary["digest"]) == 32


def test_a_member_without_permission_to_join(tmp_path):
    done = minerva(tmp_path, "run", failing_world(tmp_path, "Impostor"), "--json")
    assert done.returncode == 2
    assert "eNone" in only_summary(done.stdout)["ended"]


def test_a_command_that_cannot_run(tmp_path):
    path = write_world(tmp_path, '[process.one]\ncommand = ["false"]\nrestarts = 0\n')
    done = minerva(tmp_path, "run", path, "--json")
    assert done.returncode == 1
    assert "ended with exit code 1" in only_summary(done.stdout)["ended"]


def test_a_port_that_is_taken(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        at = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        done = minerva(tmp_path, "run", write_world(tmp_path), "--json", "--listen", at)
    assert done.returncode == 1
    assert "cannot listen" in only_summary(done.stdout)["ended"]
    assert done.stderr.count(f"cannot listen at {at}") == len(done.stderr.splitlines()) == 1


BROKEN_COORDINATOR = """
import minerva_bus.frame.algorithm as algorithm

def fail(self, stimulus):
    raise ZeroDivisionError("the coordinator's own fault")

algorithm.FrameAlgorithm.receive = fail
from minerva_bus.cli.main import main
main()
"""


def test_a_failing_coordinator(tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", BROKEN_COORDINATOR, "run", write_world(tmp_path), "--json"],
        cwd=tmp_path, env=environment(tmp_path), capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert done.returncode == 1
    summary = only_summary(done.stdout)
    assert "ZeroDivisionError" in summary["ended"]
    assert summary["digest"] is None


WHILE_IMPORTING = """
import os, signal, sys

class Interrupting:
    def find_spec(self, name, path=None, target=None):
        if name == "minerva_bus.launch.supervisor":
            os.kill(os.getpid(), NUMBER)

sys.meta_path.insert(0, Interrupting())
from minerva_bus.cli.main import main
main()
"""


@pytest.mark.parametrize(("number", "word"), [
    (signal.SIGINT, "interrupted"), (signal.SIGTERM, "terminated"), (signal.SIGHUP, "terminated"),
])  # fmt: skip
def test_a_signal_during_imports(tmp_path, number, word):
    code = WHILE_IMPORTING.replace("NUMBER", str(int(number)))
    done = subprocess.run(
        [sys.executable, "-c", code, "run", write_world(tmp_path), "--json"], cwd=tmp_path,
        env=environment(tmp_path), capture_output=True, text=True, check=False,
        preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_DFL),
    )  # fmt: skip
    assert done.returncode == 130
    assert only_summary(done.stdout)["ended"] == word
    assert "Traceback" not in done.stderr
