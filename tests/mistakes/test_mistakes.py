"""Reports of beginners' mistakes are a few lines, with file and line of the user's code."""

import os
import sys
from pathlib import Path

import pytest
from mistakes import HARMLESS, MISTAKES, Mistake

import minerva_bus.cli.checking
import minerva_bus.cli.running
import minerva_bus.launch.resuming  # noqa: F401  (so that forks need not import it all)
from minerva_bus.cli.main import app, main

ERROR, ALL = 10, 25


@pytest.fixture(scope="module", autouse=True)
def warm():
    """Trigger the lazy imports of the command line before the forks."""
    with pytest.raises(SystemExit):
        app(["check", "nothing.mnv"])


def minerva(folder: Path, *words: str) -> tuple[int, str]:
    """Exit code and output of a command in a forked process, which imports the modules again."""
    output = folder / "output"
    pid = os.fork()
    if not pid:
        code = 1
        try:
            descriptor = os.open(output, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(descriptor, 1)
            os.dup2(descriptor, 2)
            sys.stdout, sys.stderr = os.fdopen(1, "w"), os.fdopen(2, "w")
            sys.argv = ["minerva", *map(str, words)]
            main()
            code = 0
        except SystemExit as ended:
            code = ended.code if isinstance(ended.code, int) else int(bool(ended.code))
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code)
    _, status = os.waitpid(pid, 0)
    return os.waitstatus_to_exitcode(status), output.read_text(encoding="utf-8")


def explained(mistake: Mistake, text: str) -> None:
    assert "Traceback" not in text
    for word in mistake.says:
        assert word in text
    if mistake.at:
        assert f"garden.py:{mistake.line}" in text


@pytest.mark.parametrize("mistake", MISTAKES, ids=lambda one: one.name)
def test_a_mistake_is_explained_in_a_few_lines(mistake, tmp_path):
    path = mistake.write(tmp_path)
    code, text = minerva(tmp_path, "run", path, "--in-process")
    explained(mistake, text)
    assert len(text.splitlines()) <= ERROR
    assert code in (1, 2) or mistake.goes_on
    checked, said = minerva(tmp_path, "check", path)
    if code == 2:  # `check` finds mistakes that prevent a run.
        assert checked == 1
        explained(mistake, said)


@pytest.mark.parametrize("allowed", HARMLESS, ids=lambda one: one.name)
def test_permitted_actions_log_nothing(allowed, tmp_path):
    code, text = minerva(tmp_path, "run", allowed.write(tmp_path), "--in-process")
    assert code == 0
    assert "failed" not in text


def test_all_frames_are_shown_to_devices_that_want_them(tmp_path):
    mistake = next(one for one in MISTAKES if one.name == "exception in an activity")
    code, text = minerva(tmp_path, "run", mistake.write(tmp_path), "--in-process", "--traceback")
    assert code == 1
    assert "Traceback (most recent call last)" in text
    assert "minerva_bus/world/agent_step.py" in text
    assert f"garden.py:{mistake.line}" in text


ON_THE_BUS = [
    "exception in an activity",
    "exception in a view",
    "exception in a generator",
    "not a number",
    "calls sys.exit",
]


@pytest.mark.parametrize("name", ON_THE_BUS)
def test_on_the_bus_it_is_reported_once_and_the_world_stops(name, tmp_path):
    mistake = next(one for one in MISTAKES if one.name == name)
    code, text = minerva(tmp_path, "run", mistake.write(tmp_path))
    explained(mistake, text)
    assert code == 1
    assert len(text.splitlines()) <= ALL
    assert text.count(f"garden.py:{mistake.line}") == 1
    assert "restart 1 of 5" in text
    assert "restart 2 of 5" not in text
    assert "with the same error in the same frame" in text


def test_the_same_failure_of_several_processes_is_reported_once(tmp_path):
    mistake = next(one for one in MISTAKES if one.name == "exception in an activity")
    path = mistake.write(tmp_path)
    agents = " · ".join(f"APlant#p{n}" for n in range(8))
    text = path.read_text().replace("APlant#a · APlant#b", agents)
    path.write_text(text.replace("[process.plants]", "[process.plants]\nprocesses = 3"))
    code, text = minerva(tmp_path, "run", path)
    assert code == 1
    assert len(text.splitlines()) <= ALL
    assert text.count(f"garden.py:{mistake.line}") == 1
