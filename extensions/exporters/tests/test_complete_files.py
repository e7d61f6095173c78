"""Files of exported tables appear when they are complete, and a link stays."""

import pytest

from minerva_analysis.table_files import TableFiles
from minerva_bus import record
from minerva_bus.collect.data_tables import CsvWriter
from minerva_bus.collect.plans import TablePlan
from minerva_exporters import export_dataset
from tests.api.frogs import pond
from tests.odd_arguments import check_refusals

PLAN = TablePlan("t", 1, {"n": "int64"})


def test_an_error_of_writing_names_the_file_and_leaves_none(tmp_path, monkeypatch):
    def fail(writer):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(CsvWriter, "finish", fail)
    with (
        pytest.raises(OSError, match="No space") as caught,
        TableFiles(tmp_path / "a.csv", several=False, sparse=False) as files,
    ):
        files.open(PLAN).close()
    assert caught.value.filename == str(tmp_path / "a.csv")
    assert not list(tmp_path.iterdir())


def test_a_link_stays_and_names_the_new_file(tmp_path):
    table, folder = tmp_path / "a.csv", tmp_path / "elsewhere"
    folder.mkdir()
    table.symlink_to(folder / "b.csv")
    with TableFiles(table, several=False, sparse=False) as files:
        files.open(PLAN).close()
    assert table.is_symlink()
    assert table.read_text() == "n\n"
    assert [path.name for path in folder.iterdir()] == ["b.csv"]


def test_odd_formats_of_data_sets_are_refused_by_an_error_of_ours(tmp_path):
    record(pond(), tmp_path / "pond.mcap", frames=2)
    check_refusals(lambda odd: export_dataset(tmp_path / "pond.mcap", tmp_path / "set", odd))
