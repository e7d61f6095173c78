"""Tables of results: in files, and as tables in columns."""

import pytest

from minerva_analysis.tables import read_table
from minerva_study.results import ResultTable, write
from minerva_study.study_tables import data_table


def test_numbers_beyond_a_float_are_texts(tmp_path):
    results = ResultTable(("n",), ("n",), ((10**400,), (1,)))
    assert data_table("t", results).types == {"n": "text"}
    pytest.importorskip("pyarrow")
    write(results, tmp_path / "t.parquet")
    assert read_table(tmp_path / "t.parquet")["n"].tolist() == [str(10**400), "1"]
