"""Parts of tables: joined files equal those that are written at once, and damage is reported."""

import json

import numpy as np
import pytest
from frogs import Frog, pond

from minerva_bus import count, run
from minerva_bus.collect import thrift
from minerva_bus.collect.joining import join_parts
from minerva_bus.collect.parts import TableParts, read_parts
from minerva_bus.collect.plans import TablePlan
from minerva_bus.collect.writers import create_writer, read_columns
from minerva_bus.errors import MisuseError

TYPES = {"frame": "int64", "on": "bool", "name": "text"} | {f"x{n}": "float64" for n in range(20)}
PLAN = TablePlan("AFrog", 1, TYPES, "AFrog")


def rows(frame, number=5):
    made = {"frame": np.full(number, frame), "on": np.arange(number) % 2 == 0}
    made["name"] = np.array([f"{frame} é\n{n}" for n in range(number)], object)
    return made | {f"x{n}": np.arange(number) + 0.5 * n for n in range(20)}


def written(path, chunks):
    writer = create_writer(path, TYPES)
    for chunk in chunks:
        writer.write(chunk)
    writer.finish()
    return path


def content(path):
    if path.suffix == ".csv":
        return path.read_bytes()
    if path.suffix == ".columns":
        return list(read_columns(path, "t", TYPES).rows())
    parquet = pytest.importorskip("pyarrow.parquet")
    table = parquet.read_table(path)
    table.validate(full=True)
    return table.to_pydict()


@pytest.mark.parametrize("ending", [".csv", ".parquet", ".columns"])
@pytest.mark.parametrize("sizes", [[1], [1, 1], [3, 1, 2], [1] * 40])
def test_joined_parts_equal_a_file_that_is_written_at_once(tmp_path, ending, sizes):
    frame, parts, chunks = 0, [], []
    for number, size in enumerate(sizes):
        own = [rows(frame + n) for n in range(size)]
        parts.append(written(tmp_path / f"{number}{ending}", own))
        chunks += own
        frame += size
    whole = written(tmp_path / f"whole{ending}", chunks)
    joined = tmp_path / f"joined{ending}"
    with joined.open("wb") as file:
        join_parts(parts, file, ending)
    assert content(joined) == content(whole)


@pytest.mark.parametrize("library", ["pandas", "polars"])
def test_other_libraries_read_a_joined_parquet_file(tmp_path, library):
    reader = pytest.importorskip(library)
    pytest.importorskip("pyarrow")
    joined = tmp_path / "joined.parquet"
    with joined.open("wb") as file:
        parts = [written(tmp_path / f"{n}.parquet", [rows(n)]) for n in range(20)]
        join_parts(parts, file, ".parquet")
    found = reader.read_parquet(joined)
    assert list(found["frame"]) == [n for n in range(20) for _ in range(5)]
    assert list(found["x19"]) == list(rows(0)["x19"]) * 20


def test_a_footer_is_encoded_as_it_was_decoded(tmp_path):
    pytest.importorskip("pyarrow")
    data = written(tmp_path / "t.parquet", [rows(n) for n in range(20)]).read_bytes()
    size = int.from_bytes(data[-8:-4], "little")
    footer = data[-8 - size : -8]
    assert thrift.encode(thrift.decode(footer)) == footer
    for cut in range(0, size - 1, size // 20):
        with pytest.raises(ValueError, match="Thrift"):
            thrift.decode(footer[:cut])


@pytest.mark.parametrize(
    "damage", [b"", b"PAR1", b"PAR1 and no footer", b"PAR1\xff\xff\xff\xffPAR1"]
)
def test_a_damaged_part_is_named(tmp_path, damage):
    part = tmp_path / "0.parquet"
    part.write_bytes(damage)
    with (
        (tmp_path / "joined.parquet").open("wb") as file,
        pytest.raises(MisuseError, match=r"0\.parquet is not"),
    ):
        join_parts([part], file, ".parquet")


@pytest.mark.parametrize("ending", [".csv", ".parquet"])
def test_a_process_that_repeats_frames_continues_a_table(tmp_path, ending):
    path = tmp_path / f"out{ending}"
    parts = TableParts(path, {"AFrog": TYPES})
    writer = parts.open(PLAN)
    for frame in range(4):
        writer.rows(rows(frame))
        parts.save()
    writer.rows(rows(4))  # Not saved: the process is killed here.
    (parts.folder / f".draft{ending}").write_bytes(b"half a part")
    parts = TableParts(path, {"AFrog": TYPES}, again=True)
    writer = parts.open(PLAN)
    for frame in range(2, 6):
        writer.rows(rows(frame))
    writer.close()
    assert parts.join() == {"AFrog": path}
    assert content(path) == content(written(tmp_path / f"w{ending}", [rows(n) for n in range(6)]))
    assert not parts.folder.exists()


def test_a_part_is_not_lost_or_doubled_when_its_replacement_is_interrupted(tmp_path):
    parts = TableParts(tmp_path / "out.csv", {"AFrog": TYPES})
    writer = parts.open(PLAN)
    writer.rows(rows(0))
    parts.save()
    before = next(parts.folder.glob("AFrog-*"))
    data = before.read_bytes()
    writer.rows(rows(1))
    parts.save()
    assert not before.exists()
    before.write_bytes(data)  # As if the process was killed before it removed the former part.
    files = read_parts(parts.folder).join()
    assert content(files["AFrog"]) == content(written(tmp_path / "w.csv", [rows(0), rows(1)]))


def test_parts_of_a_killed_run_are_not_overwritten(tmp_path):
    into = tmp_path / "out.csv"
    TableParts(into, {"frames": {"frame": "int64"}})
    with pytest.raises(MisuseError, match=r"`minerva recover .*out\.csv\.parts`"):
        run(pond(), frames=2, collect={"n": count(Frog)}, into=into)
    files = read_parts(tmp_path / "out.csv.parts").join()
    assert files["frames"].read_text() == "frame\n"
    with pytest.raises(MisuseError, match="no folder with the parts of tables"):
        read_parts(tmp_path)


def test_a_run_leaves_no_parts_and_tables_without_rows_have_a_file(tmp_path):
    collect = {"n": count(Frog), "old": Frog.age.where("age > 100")}
    run(pond(), frames=3, collect=collect, into=tmp_path / "out.csv")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out-AFrog.csv", "out-frames.csv"]
    assert (tmp_path / "out-AFrog.csv").read_text() == "frame,id,old\n"


def test_tables_of_parts_are_described(tmp_path):
    parts = TableParts(tmp_path / "out.csv", {"AFrog": {"frame": "int64", "x": "float64"}})
    about = json.loads((parts.folder / "tables.json").read_text())
    assert about == {"AFrog": {"frame": "int64", "x": "float64"}}
