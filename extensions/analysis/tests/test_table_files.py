"""Tables in files: what is written is read, and damaged files are named."""

import os

import numpy as np
import pytest

from minerva_analysis.tables import read_table
from minerva_bus.collect.data_tables import DataTable
from minerva_bus.errors import MinervaError, MisuseError


def swept():
    """Two options with three seeds each, of 5 frames; `n` is 10 * option + frame + seed."""
    rows = [(birds, seed, frame) for birds in (1, 2) for seed in range(3) for frame in range(5)]
    birds, seeds, frames = np.array(rows).T
    columns = {
        "birds": birds, "seed": seeds, "frame": frames, "time": 0.5 * frames,
        "n": 10 * birds + frames + seeds, "gap": np.where(frames == 2, np.nan, 1.0),
    } | {f"size_{bin_}": frames + bin_ for bin_ in range(4)}  # fmt: skip
    types = {name: "float64" if name in ("time", "gap") else "int64" for name in columns}
    return DataTable("swept", types, columns)


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_tables_are_read_from_files_as_they_were_written(tmp_path, ending):
    if ending == "parquet":
        pytest.importorskip("pyarrow")
    path = tmp_path / f"t.{ending}"
    getattr(swept(), f"to_{ending}")(path)
    table = read_table(path)
    assert table.types == swept().types
    for name in table.columns:
        np.testing.assert_array_equal(table[name], swept()[name])


def test_numbers_beyond_a_float_are_texts(tmp_path):
    (tmp_path / "t.csv").write_text(f"n,m,k\n{10**400},{2**64},1\n1,,2\n")
    table = read_table(tmp_path / "t.csv")
    assert table.types == {"n": "text", "m": "float64", "k": "int64"}


def test_a_pipe_is_no_table(tmp_path):
    os.mkfifo(tmp_path / "t.csv")
    with pytest.raises(MisuseError, match=r"t\.csv: no table can be read: it is a pipe"):
        read_table(tmp_path / "t.csv")


@pytest.mark.parametrize("content", [b"", b"a,a\n1,2\n", b"a,b\n1\n", b"\xff\xfe\x00"])
@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_damaged_tables_are_named(tmp_path, content, ending):
    path = tmp_path / f"t.{ending}"
    path.write_bytes(content)
    with pytest.raises(MinervaError, match=f"t.{ending}: no table can be read"):
        read_table(path)
