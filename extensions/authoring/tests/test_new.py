"""`minerva new KIND NAME`: each package passes its own tests and runs in a world."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from minerva_authoring import scaffold as scaffolding
from minerva_authoring.commands import complete_kinds
from minerva_authoring.scaffold import KINDS, TEMPLATES, copy_world, scaffold
from minerva_bus.cli.main import app
from minerva_bus.errors import MisuseError, WorldFileError

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def packages(tmp_path_factory):
    folder = tmp_path_factory.mktemp("own")
    return {kind: scaffold(kind, f"my_{kind}", folder) for kind in KINDS}


def minerva(*words):
    app([*words], standalone_mode=False)


def run(folder, *words):
    paths = os.pathsep.join(str(ROOT / part) for part in (".", "services", "agents", "worlds"))
    environment = {**os.environ, "PYTHONPATH": paths}
    return subprocess.run(
        [sys.executable, "-m", *words], cwd=folder, env=environment, capture_output=True, text=True
    )


def run_world(folder, name):
    words = ("run", name, "--in-process", "--rate", "100", "--json")
    done = run(folder, "minerva_bus", *words)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_every_template_is_a_kind():
    assert {path.name for path in TEMPLATES.iterdir()} == set(KINDS)


@pytest.mark.parametrize("kind", KINDS)
def test_its_own_tests_pass(packages, kind):
    done = run(packages[kind], "pytest", "-q", "-p", "no:cacheprovider")
    assert done.returncode == 0, done.stdout + done.stderr
    assert " passed" in done.stdout


@pytest.mark.parametrize("kind", KINDS)
def test_its_files_are_complete(packages, kind):
    package = packages[kind]
    done = run(package, "ruff", "check", "--isolated", ".")
    assert done.returncode == 0, done.stdout
    for path in package.rglob("*.*"):
        assert path.is_dir() or "$name" not in path.read_text(errors="replace"), path
        assert path.is_dir() or path.stat().st_mode & 0o444 == 0o444, path
    assert "minerva run" in (package / "README.md").read_text()


def test_a_bridge_counts_damaged_lines(packages):
    result = run_world(packages["bridge"], "yard.toml")
    assert (result["garbage"], result["readings"]) == (1, 3), result


def test_a_world_runs_with_the_agent(packages):
    assert run_world(packages["agent"], "yard.toml")["frames"] == 60


def test_a_service_reports(packages):
    assert run_world(packages["service"], "yard.toml")["showers"] > 0


def test_a_geometry_draws(packages):
    run_world(packages["geometry"], "yard.toml")
    text = (packages["geometry"] / "my_geometry.txt").read_text()
    assert sum(text.count(sign) for sign in "<>^v") == 4, text


def test_a_world_has_options(packages):
    words = ("run", "my_world.toml", "--in-process", "--frames", "20", "--json")
    digests = [
        json.loads(run(packages["world"], "minerva_bus", *words, *options).stdout)["digest"]
        for options in ((), ("--walkers", "12"), ("--walkers", "3"))
    ]
    assert digests[0] == digests[1] != digests[2]


def test_nothing_is_overwritten(tmp_path):
    (tmp_path / "meter").mkdir()
    (tmp_path / "meter" / "notes").write_text("kept")
    with pytest.raises(MisuseError, match="meter already exists; nothing was written"):
        scaffold("bridge", "meter", tmp_path)
    assert [path.name for path in tmp_path.rglob("*")] == ["meter", "notes"]


@pytest.mark.parametrize(
    ("name", "problem"),
    [
        ("Wind-Meter", "expected a lower-case letter .*such as wind_meter"),
        ("../x", "invalid name"),
        ("", "invalid name"),
        ("x" * 41, "at most 39"),
        ("class", "a keyword of Python"),
        ("socket", "the name of another module"),
        ("numpy", "the name of another module"),
        ("laser", "already installed .minerva.services"),
        ("robot", "already installed .minerva.agents"),
    ],
)
def test_invalid_names(tmp_path, name, problem):
    with pytest.raises(MisuseError, match=problem):
        scaffold("bridge", name, tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_folder_that_cannot_be_written_to(tmp_path):
    with pytest.raises(MisuseError, match="cannot be written: No such file"):
        scaffold("world", "meter", tmp_path / "nowhere")


def test_the_command_prints_the_next_steps(tmp_path, capsys, monkeypatch):
    minerva("new", "world", "metre", "--in", str(tmp_path))
    assert "pip install" not in capsys.readouterr().out
    monkeypatch.setattr(scaffolding, "find_spec", lambda name: None)
    minerva("new", "world", "meter", "--in", str(tmp_path))
    printed = capsys.readouterr().out
    assert re.search(r"pip install pytest +# for its tests\n +pytest +#", printed)
    assert f"cd {tmp_path / 'meter'}" in printed
    assert "minerva run meter.toml" in printed
    with pytest.raises(MisuseError, match="kind 'wordl'; did you mean 'world'"):
        minerva("new", "wordl", "meter", "--in", str(tmp_path))


def test_an_installed_world_is_copied(tmp_path, capsys):
    minerva("new", "world", "fields", "--in", str(tmp_path), "--from", "meadow")
    assert "minerva run meadow.toml" in capsys.readouterr().out
    assert {path.name for path in (tmp_path / "fields").iterdir()} >= {"meadow.py", "meadow.toml"}
    words = ("run", "meadow.toml", "--in-process", "--frames", "5", "--json")
    done = run(tmp_path / "fields", "minerva_bus", *words)
    assert json.loads(done.stdout)["frames"] == 5, done.stderr


def test_the_copy_of_a_world_of_a_package_is_one_file(tmp_path):
    assert names_in(copy_world("robot", "office", tmp_path).parent) == ["robot.toml"]


def test_the_copy_of_a_world_has_the_programs_beside_it(tmp_path):
    there = names_in(copy_world("ros2", "field", tmp_path).parent)
    assert {"ros_robot.py", "nav2.py", "node.py", "rover.toml", "rover.py"} <= {*there}


def names_in(folder):
    return sorted(path.name for path in folder.iterdir())


def test_what_cannot_be_copied(tmp_path):
    with pytest.raises(WorldFileError, match="no world 'medow'; did you mean 'meadow'"):
        copy_world("medow", "fields", tmp_path)
    with pytest.raises(MisuseError, match="invalid name"):
        copy_world("meadow", "../x", tmp_path)
    with pytest.raises(MisuseError, match="--from copies a world"):
        minerva("new", "agent", "fields", "--in", str(tmp_path), "--from", "meadow")
    assert not list(tmp_path.iterdir())


def test_kinds_are_completed():
    assert complete_kinds(None, "ge") == [("geometry", "")]
