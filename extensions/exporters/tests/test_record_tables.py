"""Tables exported from records are those that are collected while the world runs."""

import csv
import json
import sys
from dataclasses import replace

import numpy as np
import pytest

from minerva_analysis import export
from minerva_bus import World, count, data, each, run
from minerva_bus.api.running import run_file
from minerva_bus.cli.main import app
from minerva_bus.collect.plans import read_entries
from minerva_bus.errors import MinervaError, MisuseError, RecordError, VocabularyError
from minerva_bus.launch.world_files import Collecting
from minerva_bus.log.record import Record
from minerva_bus.settings.world_settings import Overrides
from tests.api.frogs import Frog, eCroak, eCross, pond, race

pytest.importorskip("mcap", reason="pip install 'minerva-bus[record]'")

COLLECT = {
    "frogs": count(Frog), "loud": count(Frog, "mood == 'loud'"), "age": Frog.age.sum(),
    "mid": Frog.size.quantiles(0.5), "sizes": Frog.size.histogram(0, 4, 2),
    "croaks": count(eCroak), "depth": data(eCroak, "loud").mean(),
    "x": Frog.x, "mood": Frog.mood, "croak": data(eCroak),
    "late": Frog.age.where("age > 2").every(3),
}  # fmt: skip


def equal(first, other):
    """Whether two tables have the same types and values; NaN equals NaN."""
    assert first.types == other.types
    for name in first.columns:
        np.testing.assert_array_equal(first[name], other[name])
    return True


def crowd(number=100):
    """A population, whose string is large enough for columns, with events in batches."""
    return World(
        Frog.many("f", number, size=np.linspace(1, 3, number)),
        agents=[Frog], services=[each("eTick")], name="crowd",
    )  # fmt: skip


@pytest.fixture
def recorded(tmp_path):
    """A run of the pond with all its tables, and its record."""
    path = tmp_path / "pond.mcap"
    return run(pond(), frames=12, seed=3, collect=COLLECT, record=path), path


@pytest.mark.parametrize("make", [pond, crowd])
def test_exported_tables_equal_those_collected_live(tmp_path, make):
    path = tmp_path / "run.mcap"
    live = run(make(), frames=12, seed=3, collect=COLLECT, record=path)
    done = export(path, collect=COLLECT)
    assert list(done.tables) == list(live.tables)
    assert all(equal(done.tables[name], table) for name, table in live.tables.items())
    assert len(live.table("eCroak")) > 0
    assert (done.first, done.last, done.complete, done.missing) == (0, 12, True, ())
    assert done.rows == {name: len(table) for name, table in live.tables.items()}


def test_without_expressions_everything_is_exported(recorded):
    live, path = recorded
    done = export(path)
    assert set(done.tables) == {"AFrog", "eCroak", "eTick"}
    frogs = done.table("AFrog")
    assert frogs.columns == ("frame", "id", "x", "size", "age", "hungry", "mood")
    assert equal(done.table("eCroak"), live.table("eCroak"))
    np.testing.assert_array_equal(frogs["x"], live.table("x")["x"])


def test_a_range_of_frames_has_the_rows_of_these_frames(recorded):
    live, path = recorded
    done = export(path, collect=COLLECT, begin=4, end=7)
    for name, table in live.tables.items():
        rows = [row for row in table.rows() if 4 <= row[table.columns.index("frame")] <= 7]
        assert repr(list(done.tables[name].rows())) == repr(rows)
    exported = export(path, collect={"n": count(Frog), "x": Frog.x.every(4)}, begin=1, every=5)
    assert exported.table()["frame"].tolist() == [5, 10]
    assert set(exported.table("x")["frame"]) == {4, 8, 12}


def test_a_record_that_was_cut_off_is_exported_up_to_its_last_frame(recorded, tmp_path):
    live, cut = recorded[0], tmp_path / "cut.mcap"
    # Flushed after each frame, so that it has many chunks.
    run_file(pond().read(Overrides(record=str(cut), flush=0.0, frames=400, seed=3, rate=0.0)), 0.0)
    data = cut.read_bytes()
    cut.write_bytes(data[: len(data) * 2 // 3])
    done = export(cut, collect=COLLECT)
    assert not done.complete
    assert 12 < done.last < 400
    early = live.table()["age"][:12]
    np.testing.assert_array_equal(done.table()["age"][:12], early)
    assert done.table()["frame"].tolist() == list(range(done.last + 1))


def test_frames_that_are_missing_in_a_record_are_reported_and_have_no_rows(tmp_path):
    path = tmp_path / "torn.mcap"
    how = {"flush": 0.0, "frames": 120, "seed": 3, "rate": 0.0}
    file = pond().read(Overrides(record=str(path), **how))
    live = run_file(replace(file, collect=Collecting(read_entries(COLLECT))), 0.0)
    with Record(path) as record:
        places = [place.begin for place in record._chunks.places]
    content = bytearray(path.read_bytes())
    begin = places[len(places) // 3]
    content[begin : begin + 100] = bytes(100)
    path.write_bytes(content)
    done = export(path, collect=COLLECT)
    gap = done.missing[0]
    assert len(done.missing) == 1
    for name, table in live.tables.items():
        lost = {*gap} if name in ("frames", "eCroak") else {*gap} - {gap.start}
        rows = [row for row in table.rows() if row[table.columns.index("frame")] not in lost]
        assert repr(list(done.tables[name].rows())) == repr(rows)


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_files_have_the_rows_of_live_files(recorded, tmp_path, ending):
    _, path = recorded
    export(path, collect=COLLECT, into=tmp_path / f"later.{ending}")
    run(pond(), frames=12, seed=3, collect=COLLECT, into=tmp_path / f"live.{ending}")
    for table in ("frames", "AFrog", "eCroak", "AFrog_late"):
        first, other = (tmp_path / f"{name}-{table}.{ending}" for name in ("later", "live"))
        if ending == "csv":
            assert first.read_bytes() == other.read_bytes()
        else:
            parquet = pytest.importorskip("pyarrow.parquet")
            # As texts, because NaN is not equal to itself.
            assert repr(parquet.read_table(first).to_pydict()) == repr(
                parquet.read_table(other).to_pydict()
            )


def test_a_failed_export_leaves_no_file_and_keeps_the_former_one(recorded, tmp_path):
    _, path = recorded
    pytest.importorskip("pyarrow")
    into = tmp_path / "x.parquet"
    export(path, collect=[Frog.x], into=into)
    before = into.read_bytes()

    def interrupt(done, total):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        export(path, collect=[Frog.x], into=into, progress=interrupt)
    assert into.read_bytes() == before
    assert sorted(file.name for file in tmp_path.iterdir()) == ["pond.mcap", "x.parquet"]


@pytest.mark.parametrize(("collect", "problem"), [
    ({"x": "AFrog.y"}, r"(?s)AFrog has no y.*AFrog\.y\n +\^"),
    ({"x": "count(AFog)"}, r"(?s)no agent kind AFog; did you mean 'AFrog'.*\n +\^"),
    ({"x": "averge(AFrog.x)"}, "no function averge"),
    ({"x": "count(AFrog, mod == 1)"}, r"(?s)AFrog has no mod.*\n +\^"),
])  # fmt: skip
def test_wrong_expressions_are_shown_with_a_caret(recorded, collect, problem):
    with pytest.raises(VocabularyError, match=problem):
        export(recorded[1], collect=collect)


def test_wrong_arguments_are_reported(recorded, tmp_path):
    path = recorded[1]
    with pytest.raises(RecordError, match="it has"):
        export(path, begin=40)
    with pytest.raises(MisuseError, match="every must be a whole number from 1, not 0"):
        export(path, every=0)
    with pytest.raises(MisuseError, match="at least one expression"):
        export(path, collect={})
    with pytest.raises(MisuseError, match=r"\.parquet or \.csv"):
        export(path, into=tmp_path / "x.xls")
    with pytest.raises(MinervaError):
        export(tmp_path / "none.mcap")


@pytest.mark.skipif(sys.platform != "linux", reason="without /proc, in which nobody can write")
@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_a_file_that_cannot_be_written_is_named_as_it_was_given(recorded, ending):
    named = f"^/proc/frogs.{ending}: cannot be written: No such file or directory$"
    with pytest.raises(MisuseError, match=named):
        export(recorded[1], collect=[Frog.x], into=f"/proc/frogs.{ending}")


def minerva(*words):
    """Run the command; returns its exit code."""
    try:
        app([str(word) for word in words], standalone_mode=False)
    except SystemExit as ended:
        return ended.code
    return 0


def test_the_command_writes_csv_to_standard_output(recorded, capsys):
    live, path = recorded
    minerva("export", path, "--collect", "n=count(AFrog, age > 2)", "--collect", "sum(AFrog.age)")
    rows = list(csv.reader(capsys.readouterr().out.splitlines()))
    assert rows[0] == ["frame", "time", "n", "sum_AFrog_age"]
    assert [int(row[3]) for row in rows[1:]] == live.table()["age"].tolist()


def test_the_command_writes_files_and_a_summary(recorded, tmp_path, capsys):
    _, path = recorded
    minerva("export", path, "--csv", tmp_path / "all.csv", "--from", 2, "--to", 5, "--json")
    plain = json.loads(capsys.readouterr().out)
    assert plain["frames"] == [2, 5]
    assert plain["tables"]["AFrog"]["rows"] == 12
    assert (tmp_path / "all-AFrog.csv").read_text().count("\n") == 13
    minerva("export", path, "--csv", tmp_path / "x.csv", "--collect", "AFrog.x")
    assert capsys.readouterr().out == f"{tmp_path}/x.csv  AFrog  39 rows\n"


@pytest.mark.parametrize(("words", "problem"), [
    (["--collect", "n=count(AFog)"], r"(?s)--collect n:1:7: .*did you mean 'AFrog'.*\^"),
    (["--collect", "n=count(AFrog", "--collect", "n=count(AFrog)"], "twice|cannot be read"),
    ([], "several tables"),
    (["--csv", "a.csv", "--parquet", "a.parquet"], "exclude each other"),
    (["--csv", "a.parquet"], r"expected a name that ends in \.csv"),
    (["--collect", "AFrog.x", "--json"], "--json needs --csv or --parquet"),
])  # fmt: skip
def test_the_command_reports_wrong_input(recorded, words, problem, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(MinervaError, match=problem):
        minerva("export", recorded[1], *words)


def test_events_that_agents_send_in_the_last_frame_are_exported(tmp_path):
    path = tmp_path / "race.mcap"
    run(race("anna"), frames=9, record=path, until="eCross")
    tables = export(path, collect={"crossed": count(eCross), "rows": data(eCross)}).tables
    assert tables["frames"]["crossed"].tolist() == [0, 0, 0, 1]
    assert tables["eCross"]["frame"].tolist() == [3]
