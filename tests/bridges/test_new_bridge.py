"""`minerva new bridge NAME`: what is written passes its own tests, and runs in a world."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from minerva_bus.cli.making import make_new
from minerva_bus.errors import MisuseError
from minerva_bus.launch.skeleton import write_bridge

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    return write_bridge("wind_meter", tmp_path_factory.mktemp("own"))


def run(folder, *words):
    paths = os.pathsep.join(str(ROOT / one) for one in (".", "services", "agents"))
    environment = {**os.environ, "PYTHONPATH": paths}
    return subprocess.run(
        [sys.executable, "-m", *words], cwd=folder, env=environment, capture_output=True, text=True
    )


def test_its_own_tests_pass(written):
    done = run(written, "pytest", "-q", "-p", "no:cacheprovider")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "4 passed" in done.stdout


def test_a_world_receives_it(written):
    words = ("run", "yard.toml", "--in-process", "--rate", "100", "--json")
    done = run(written, "minerva_bus.cli.main", *words)
    assert done.returncode == 0, done.stderr
    assert '"garbage": 1' in done.stdout, done.stdout
    assert '"readings": 3' in done.stdout


def test_what_is_written_is_as_it_should_be(written):
    files = {str(path.relative_to(written)) for path in written.rglob("*") if path.is_file()}
    assert files >= {"pyproject.toml", "README.md", "wind_meter/bridge.py", "tests/test_bridge.py"}
    assert 'wind_meter = "wind_meter:WindMeter"' in (written / "pyproject.toml").read_text()
    done = run(written, "ruff", "check", "--isolated", ".")
    assert done.returncode == 0, done.stdout
    for path in written.rglob("*"):
        assert path.is_dir() or "$name" not in path.read_text(errors="replace"), path
        assert path.stat().st_mode & 0o444 == 0o444, path


def test_nothing_is_written_over(tmp_path):
    (tmp_path / "meter").mkdir()
    (tmp_path / "meter" / "mine").write_text("kept")
    with pytest.raises(MisuseError, match="meter is there already; nothing was written"):
        write_bridge("meter", tmp_path)
    assert [path.name for path in tmp_path.rglob("*")] == ["meter", "mine"]


@pytest.mark.parametrize(
    ("name", "problem"),
    [
        ("Wind-Meter", "begins with a small letter, .*such as wind_meter"),
        ("../x", "cannot name a bridge"),
        ("", "cannot name a bridge"),
        ("x" * 41, "up to 40"),
        ("class", "a word of Python's own"),
        ("socket", "a module that others import"),
        ("numpy", "a module that others import"),
        ("laser", "a service 'laser' is installed already"),
    ],
)
def test_names_that_cannot_be(tmp_path, name, problem):
    with pytest.raises(MisuseError, match=problem):
        write_bridge(name, tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_folder_that_cannot_be_written_to(tmp_path):
    with pytest.raises(MisuseError, match="cannot be written: No such file"):
        write_bridge("meter", tmp_path / "nowhere")


def test_the_command_prints_the_next_step(tmp_path, capsys):
    make_new("bridge", "meter", tmp_path)
    assert f"cd {tmp_path / 'meter'}" in capsys.readouterr().out
    with pytest.raises(MisuseError, match="kind 'brige'; did you mean 'bridge'"):
        make_new("brige", "meter", tmp_path)


def test_the_bridge_in_the_document_works(tmp_path):
    from minerva_services.bridging.testing import Running

    page = (ROOT / "docs" / "bridges.md").read_text(encoding="utf-8")
    blocks = [one.partition("```")[0] for one in page.split("```python")[1:]]
    world = {}
    exec(blocks[0].partition("\n")[2], world)  # its first line names it
    exec(blocks[1], world)
    world["test_a_battery_is_read"](tmp_path)
    (tmp_path / "capacity").write_text("much")
    with Running(world["Laptop"](str(tmp_path))) as running:
        running.wait_for(lambda: running.counted("garbage"), "garbage is counted")
        (tmp_path / "capacity").unlink()
        running.wait_for(lambda: "is gone" in running.state, "it is missed")
