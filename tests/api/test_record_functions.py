"""Functions about records give what the commands give: strings, tables, differences."""

from pathlib import Path

import pytest
from frogs import Frog, pond

from minerva_bus import MinervaError, count, record, replay, replay_views, resume, run
from minerva_bus.errors import MisuseError, WorldFileError
from tests.runtime.running import here, minerva, summary

pytest.importorskip("mcap", reason="pip install 'minerva-bus[record]'")

CURVES = {"n": count(Frog), "x": Frog.x}
PAPER = "svg:path={},every=5"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with the world file of a pond and its record, of 10 frames."""
    made = tmp_path_factory.mktemp("records")
    pond(collect=CURVES).save(made / "pond.toml")
    record(made / "pond.toml", made / "run.mcap", frames=10, seed=5)
    return made


@pytest.fixture
def copy(folder, tmp_path):
    """A copy of the record, which a resumed run continues."""
    made = tmp_path / "run.mcap"
    made.write_bytes((folder / "run.mcap").read_bytes())
    return made


def rows(table):
    return {name: table[name].tolist() for name in table.columns}


@pytest.mark.parametrize("bus", [False, True])
def test_a_resumed_run_has_the_strings_of_a_whole_one_and_of_the_command(folder, copy, bus):
    whole = run(folder / "pond.toml", frames=20, seed=5, collect=CURVES)
    # The command leaves the record as it is, so the function continues the same one.
    words = "--resume", copy, "--frames", 20, "--record", copy.with_name("other.mcap")
    command = summary(here(folder, "run", *words, "--in-process", "--json"))
    done = resume(copy, frames=20, collect=CURVES, bus=bus, film=5)
    assert (done.frames, done.digest) == (20, whole.digest)
    assert (command["frames"], command["digest"]) == (20, whole.digest)
    frames, agents = whole.table(), whole.table("AFrog")
    assert rows(done.table()) == {name: rows(frames)[name][10:] for name in frames.columns}
    assert rows(done.table("AFrog"))["x"] == agents["x"][agents["frame"] >= 10].tolist()
    assert [frame for frame, _ in done.kept] == [10, 15, 20]


def test_a_resumed_run_writes_another_record_and_a_table(copy):
    before, other, table = copy.read_bytes(), copy.with_name("b.mcap"), copy.with_name("t.csv")
    done = resume(copy, frames=12, collect={"n": count(Frog)}, into=table, output=other)
    assert done.into == str(table)
    assert len(table.read_text().splitlines()) == 1 + 3
    assert copy.read_bytes() == before
    assert replay(other).same
    with pytest.raises(MinervaError, match="over after 12 frames"):
        resume(other)


@pytest.mark.parametrize(("settings", "problem"), [
    ({"film": -1}, "film must be a whole number from 0, not -1"),
    ({"processes": 0}, "processes is 0"),
    ({"birds": 3}, "pond has no option 'birds'"),
])  # fmt: skip
def test_wrong_settings_of_a_resumed_run_are_named(copy, settings, problem):
    with pytest.raises(MinervaError, match=problem):
        resume(copy, frames=20, **settings)


def test_a_record_is_shown_in_a_view_as_by_the_command(folder, tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parent))
    own, other = tmp_path / "own.svg", tmp_path / "other.svg"
    words = "--view", PAPER.format(other), "--speed", 0, "--json"
    # Its processes are forked, which must not happen after this process has used Zenoh.
    command = summary(minerva(folder, "replay", folder / "run.mcap", *words))
    done = replay_views(folder / "run.mcap", PAPER.format(own), speed=0, quiet=True)
    assert (done.frames, done.ended) == (10, "the record is over")
    assert (done.digest, done.ended) == (command["digest"], command["ended"])
    assert done.scene == run(folder / "pond.toml", frames=10, seed=5).scene
    assert own.read_text() == other.read_text()


@pytest.mark.parametrize(("views", "settings", "error", "problem"), [
    ("svgg", {}, WorldFileError, "no view 'svgg'"),
    ("svg", {"begin": 10}, MisuseError, "it has frames 0 to 9, not 10"),
    ("svg", {"speed": -1}, MisuseError, "must be a number from 0"),
])  # fmt: skip
def test_a_wrong_view_or_frame_is_reported_before_processes_start(
    folder, views, settings, error, problem
):
    with pytest.raises(error, match=problem):
        replay_views(folder / "run.mcap", views, **settings)
