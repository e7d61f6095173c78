"""Tables of a world whose coordinator is killed have all rows, as those of an undisturbed run."""

import os
import signal
import sys
from contextlib import suppress

import pytest
import running
from running import MEMBERS, World, alone, eventually, minerva, write_world

from tests import starts

COLLECT = """
[collect]
into = "out.csv"
walkers = "count(AWalker)"
far = "count(AWalker, x > 3)"
mean = "mean(AWalker.x)"
events = "count(eStep)"
x = "AWalker.x"
steps = "eStep"
"""
IMPATIENT = """
import sys
from minerva_bus.launch import run_outputs
from minerva_bus.log import journal
from minerva_bus.collect import data_tables
{settings}
from minerva_bus.cli.main import main
main()
"""
NAMES = ("steps", "walkers")


def tables(folder, ending):
    """The content of all tables, without the parts and journals that a run must not leave."""
    assert not list(folder.glob("*.parts"))
    paths = {path.name: path for path in folder.glob(f"out-*{ending}")}
    if ending == ".csv":
        return {name: path.read_text() for name, path in paths.items()}
    parquet = pytest.importorskip("pyarrow.parquet")
    return {name: repr(parquet.read_table(path).to_pydict()) for name, path in paths.items()}


def world_with(folder, ending, frames):
    folder.mkdir()
    members = MEMBERS + COLLECT.replace(".csv", ending)
    return write_world(folder, members, frames=frames, rate=30)


def undisturbed(folder, ending, frames):
    path = world_with(folder, ending, frames)
    alone(path)
    return tables(folder, ending)


def run_with(monkeypatch, folder, settings):
    """Let worlds run with other settings of the package."""
    script = folder / "impatient.py"
    script.write_text(IMPATIENT.format(settings=settings))
    monkeypatch.setattr(running, "MINERVA", [sys.executable, str(script)])
    monkeypatch.setattr(starts, "PROGRAMS", (*starts.PROGRAMS, [str(script)]))


SHORT = "journal.MIN_REWRITE_BYTES, journal.REWRITE_RATIO = 1, 0"
"""The successor can repeat a few frames only: earlier rows have to be in parts."""
PARTS = "run_outputs.SAVE_SECONDS, data_tables.BUFFERED_ROWS = 0.0, 7"


# Parts are written by the same code for both endings, which differ in what a part contains.
@pytest.mark.parametrize(("ending", "settings"), [
    pytest.param(".csv", "", id="one journal"),
    pytest.param(".parquet", SHORT, id="short journals"),
    pytest.param(".csv", PARTS, id="many parts of .csv"),
    pytest.param(".parquet", PARTS, id="many parts of .parquet"),
])  # fmt: skip
def test_tables_of_a_killed_coordinator_are_continued(tmp_path, monkeypatch, ending, settings):
    whole = undisturbed(tmp_path / "whole", ending, 100)
    assert len(whole) == 3
    path = world_with(tmp_path / "killed", ending, 100)
    run_with(monkeypatch, tmp_path, settings)
    with World(path, "--json") as world:
        world.runs(*NAMES)
        for _ in range(2):
            world.kill_coordinator()
        assert world.summary()["frames"] == 100
    assert tables(tmp_path / "killed", ending) == whole


@pytest.mark.parametrize("ending", [".csv", ".parquet"])
def test_tables_of_a_run_that_is_killed_altogether_are_recovered(tmp_path, monkeypatch, ending):
    whole = undisturbed(tmp_path / "whole", ending, 300)  # more than the other one lives to see
    folder = tmp_path / "killed"
    path = world_with(folder, ending, 2000)
    parts = folder / f"out{ending}.parts"
    run_with(monkeypatch, tmp_path, "run_outputs.SAVE_SECONDS = 0.0")
    with World(path, "--json") as world:
        world.runs(*NAMES)
        eventually(lambda: [*parts.glob("eStep-*")], "rows of events")
        world.look()
        world.kill()
        for pid in world.pids.values():
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
    again = minerva(folder, "run", path)
    assert again.returncode == 2
    assert f"`minerva recover {parts.name}`" in again.stderr
    done = minerva(folder, "recover", parts)
    assert done.returncode == 0, done.stderr
    if ending == ".csv":
        for name, text in tables(folder, ending).items():
            assert text.count("\n") > 1
            assert whole[name].startswith(text)
    else:
        assert tables(folder, ending).keys() == whole.keys()
