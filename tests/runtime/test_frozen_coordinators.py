"""A coordinator that was frozen, replaced and wakes leaves tables and records to its successor."""

import json
import os
import signal
import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parent))
from running import MEMBERS, World, eventually, here, summary, write_world

COLLECT = """
[collect]
into = "{into}"
walkers = "count(AWalker)"
x = "AWalker.x"
"""
FRAMES = 400


def rows(folder, ending):
    """The content of the tables, which have no parts any more."""
    assert not list(folder.glob("*.parts"))
    paths = sorted(folder.glob(f"out-*{ending}"))
    if ending == ".csv":
        return {path.name: path.read_text() for path in paths}
    parquet = pytest.importorskip("pyarrow.parquet")
    return {path.name: repr(parquet.read_table(path).to_pydict()) for path in paths}


def world_in(folder, into, ending, rate):
    """A world file with the same world in each folder."""
    folder.mkdir(exist_ok=True)
    into.mkdir(exist_ok=True)
    members = MEMBERS + COLLECT.format(into=into / f"out{ending}")
    return write_world(folder, members, frames=FRAMES, rate=rate, name=f"frozen-{os.getpid()}")


@pytest.mark.parametrize(
    ("ending", "is_over"),
    [
        pytest.param(".csv", False, id=".csv, while it runs", marks=pytest.mark.slow),
        pytest.param(".csv", True, id=".csv, after its end"),
        pytest.param(".parquet", False, id=".parquet, while it runs"),
        pytest.param(".parquet", True, id=".parquet, after its end", marks=pytest.mark.slow),
    ],
)
def test_a_replaced_coordinator_that_wakes_changes_no_file(tmp_path, ending, is_over):
    whole, shared = tmp_path / "whole", tmp_path / "shared"
    alone = world_in(tmp_path / "alone", whole, ending, 0)
    done = summary(here(alone.parent, "run", alone, "--in-process", "--json"))
    words = "--journal", tmp_path / "kept", "--record", shared / "run.mcap"
    older_path = world_in(tmp_path / "older", shared, ending, 30)
    newer_path = world_in(tmp_path / "newer", shared, ending, 30)
    with World(older_path, *words) as older:
        older.runs("steps", "walkers")
        eventually(lambda: older.members() and older.frame > 20, "rows are collected")
        frozen = older.coordinator()
        # As on a machine that is suspended: its launcher would kill the coordinator.
        older.kill(signal.SIGSTOP)
        os.kill(frozen, signal.SIGSTOP)
        with World(newer_path, *words) as newer:
            newer.says("continuing from frame")
            newer.runs("steps", "walkers")
            if is_over:
                assert newer.ends() == 0, newer.text
            os.kill(frozen, signal.SIGCONT)
            older.kill(signal.SIGCONT)
            assert older.ends() == 1
            assert "another coordinator runs the world" in older.text
            assert newer.ends() == 0, newer.text
    assert rows(shared, ending) == rows(whole, ending)
    record = json.loads(here(tmp_path, "info", shared / "run.mcap", "--check", "--json").stdout)
    assert record["complete"]
    assert (record["frames"], record["digest"]) == (FRAMES, done["digest"])
