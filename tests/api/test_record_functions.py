"""Functions about records give what the commands give: strings, tables, differences."""

import pytest
from frogs import Frog, pond

from minerva_bus import MinervaError, count, record, resume, run
from tests.runtime.running import here, summary

pytest.importorskip("mcap", reason="pip install 'minerva-bus[record]'")

CURVES = {"n": count(Frog), "x": Frog.x}


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
