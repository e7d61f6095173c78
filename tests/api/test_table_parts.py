"""Parts of tables: joined files equal those that are written at once, and damage is reported."""

import json
import os

import numpy as np
import pytest
from frogs import Frog, pond

from minerva_bus import count, data, files, run
from minerva_bus.collect.data_tables import create_writer, read_columns
from minerva_bus.collect.plans import TablePlan
from minerva_bus.collect.table_parts import (
    TableParts,
    join_parts,
    part_ending,
    read_parts,
)
from minerva_bus.errors import MinervaError, MisuseError

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
        parts.append((written(tmp_path / f"{number}{part_ending(ending)}", own), 0))
        chunks += own
        frame += size
    whole = written(tmp_path / f"whole{ending}", chunks)
    joined = tmp_path / f"joined{ending}"
    join_parts(parts, joined, TYPES)
    assert content(joined) == content(whole)


@pytest.mark.parametrize("library", ["pandas", "polars"])
def test_other_libraries_read_a_joined_parquet_file(tmp_path, library):
    reader = pytest.importorskip(library)
    pytest.importorskip("pyarrow")
    joined = tmp_path / "joined.parquet"
    join_parts([(written(tmp_path / f"{n}.arrow", [rows(n)]), 0) for n in range(20)], joined, TYPES)
    table = reader.read_parquet(joined)
    assert list(table["frame"]) == [n for n in range(20) for _ in range(5)]
    assert list(table["x19"]) == list(rows(0)["x19"]) * 20


def test_parts_are_joined_in_the_memory_of_a_few_of_them(tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    arrow = pytest.importorskip("pyarrow")
    size = 10_000
    parts = [(written(tmp_path / f"{n}.arrow", [rows(n, size)]), 0) for n in range(30)]
    joined = tmp_path / "joined.parquet"
    # A pool that no other test uses, because a pool has the maximum of the process.
    pool = arrow.system_memory_pool()
    before = arrow.default_memory_pool()
    arrow.set_memory_pool(pool)
    try:
        join_parts(parts, joined, TYPES)
    finally:
        arrow.set_memory_pool(before)
    about = parquet.read_metadata(joined)
    assert (about.num_row_groups, about.num_rows) == (30, 30 * size)
    assert 0 < pool.max_memory() < 8 * size * 8 * len(TYPES)


def cut(data):
    return data[:-100]


def overwritten(data):
    middle = len(data) // 2
    return data[:middle] + b"\xff" * 2000 + data[middle + 2000 :]


@pytest.mark.parametrize("damaged", [lambda _: b"", lambda _: b"ARROW1", cut, overwritten])
@pytest.mark.parametrize("number", [0, 1])
def test_a_damaged_part_is_named(tmp_path, damaged, number):
    pytest.importorskip("pyarrow")
    parts = [(written(tmp_path / f"{n}.arrow", [rows(n, 500)]), 0) for n in range(2)]
    path = parts[number][0]
    path.write_bytes(damaged(path.read_bytes()))
    with pytest.raises(MisuseError, match=rf"{number}\.arrow is not a complete Arrow file"):
        join_parts(parts, tmp_path / "joined.parquet", TYPES)


@pytest.mark.parametrize("damage", [b"\xff" * 100, b"x,y\n1,2\n", b"\x93NUMPY\x01\0v\0{}"])
def test_a_damaged_part_of_another_format_is_named(tmp_path, damage):
    parts = [(written(tmp_path / f"{n}.columns", [rows(n)]), n) for n in range(2)]
    parts[1][0].write_bytes(damage)
    with pytest.raises(MisuseError, match=r"1\.columns: it is damaged"):
        join_parts(parts, tmp_path / "joined.csv", TYPES)


@pytest.mark.parametrize(
    "about",
    [
        "[" * 100_000, "[]", "{}", '{"x": 1}', '{"x": {"n": "int64"}}', '{"x": {"frame": "int9"}}',
        '{"../x": {"frame": "int64"}, "y": {"frame": "int64"}}', '{"x": {"frame": {}}}',
    ],
)  # fmt: skip
def test_a_description_of_parts_that_no_run_has_written_is_refused(tmp_path, about):
    folder = tmp_path / "out.csv.parts"
    folder.mkdir()
    (folder / "tables.json").write_text(about)
    with pytest.raises(MisuseError, match="not a folder with the parts of tables"):
        read_parts(folder)


@pytest.mark.parametrize("ending", [".csv", ".parquet"])
def test_the_table_of_an_undisturbed_run_is_not_joined(tmp_path, monkeypatch, ending):
    pytest.importorskip("pyarrow")
    monkeypatch.setattr("minerva_bus.collect.table_parts.join_parts", None)
    path = tmp_path / f"out{ending}"
    parts = TableParts(path, {"AFrog": TYPES})
    writer = parts.open(PLAN)
    for frame in range(3):
        writer.rows(rows(frame))
        parts.save()
    writer.close()
    assert parts.join() == {"AFrog": path}
    assert content(path) == content(written(tmp_path / f"w{ending}", [rows(n) for n in range(3)]))
    assert sorted(file.name for file in tmp_path.iterdir()) == [f"out{ending}", f"w{ending}"]


@pytest.mark.parametrize("ending", [".csv", ".parquet"])
def test_a_process_that_repeats_frames_continues_a_table(tmp_path, ending):
    path = tmp_path / f"out{ending}"
    parts = TableParts(path, {"AFrog": TYPES})
    writer = parts.open(PLAN)
    for frame in range(4):
        writer.rows(rows(frame))
        parts.save()
    writer.rows(rows(4))  # Not saved: the process is killed here.
    (parts.folder / f".draft{part_ending(ending)}").write_bytes(b"half a part")
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


@pytest.mark.parametrize("ending", [".csv", ".parquet", ".columns"])
@pytest.mark.parametrize("late", [1, 3, 5, 7])
def test_a_part_that_a_replaced_process_completes_late_is_not_doubled(
    tmp_path, monkeypatch, ending, late
):
    """It was frozen before it gave a part with frames up to `late` its name."""
    path = tmp_path / f"out{ending}"
    parts = TableParts(path, {"AFrog": TYPES}, again=True)
    parts.folder.mkdir()
    older, newer = parts.open(PLAN), parts.open(PLAN)
    for frame in range(late + 1):
        older.rows(rows(frame))
    # The new process completes a part every two frames.
    monkeypatch.setattr("minerva_bus.collect.data_tables.BUFFERED_ROWS", 2 * len(rows(0)["frame"]))
    for frame in range(8):
        newer.rows(rows(frame))
        if frame == 4:
            older.save()
    newer.close()
    assert parts.join() == {"AFrog": path}
    assert content(path) == content(written(tmp_path / f"w{ending}", [rows(n) for n in range(8)]))


def test_parts_of_a_killed_run_are_not_overwritten(tmp_path):
    into = tmp_path / "out.csv"
    TableParts(into, {"frames": {"frame": "int64"}})
    with pytest.raises(MisuseError, match=r"`minerva recover .*out\.csv\.parts`"):
        run(pond(), frames=2, collect={"n": count(Frog)}, into=into)
    former = tmp_path / "out.csv.parts" / "frames-000000-7.csv"
    former.write_text("frame\n7\n")
    with pytest.raises(MisuseError, match="an earlier version of Minerva Bus wrote this part"):
        read_parts(former.parent)
    former.unlink()
    files = read_parts(former.parent).join()
    assert files["frames"].read_text() == "frame\n"
    with pytest.raises(MisuseError, match="not a folder with the parts of tables"):
        read_parts(tmp_path)


@pytest.mark.parametrize("ending", [".csv", ".parquet"])
def test_a_file_that_appears_during_a_run_stays_and_so_do_the_rows(tmp_path, ending):
    path = tmp_path / f"frogs{ending}"
    if ending == ".parquet":
        pytest.importorskip("pyarrow")
    parts = TableParts(path, {"AFrog": TYPES})
    parts.open(PLAN).rows(rows(0))
    path.write_text("of a user")
    parts.save()
    why = {".csv": "exists, and a .csv file has no mark", ".parquet": "exists and was not "}
    with pytest.raises(MisuseError, match=rf"frogs.* {why[ending]}.*; the rows are in .*parts"):
        parts.join()
    assert path.read_text() == "of a user"
    path.unlink()
    assert read_parts(parts.folder).join() == {"AFrog": path}
    assert content(path) == content(written(tmp_path / f"whole{ending}", [rows(0)]))


@pytest.mark.parametrize("forced", [False, True])
def test_a_folder_of_a_user_is_no_folder_of_parts(tmp_path, monkeypatch, forced):
    monkeypatch.setattr(files, "_policy", files._Policy())
    files.force_overwriting(forced)
    kept = tmp_path / "frogs.csv.parts" / "notes.txt"
    kept.parent.mkdir()
    kept.write_text("of a user")
    with pytest.raises(MisuseError, match=r"frogs\.csv\.parts exists and is no folder of tables"):
        TableParts(tmp_path / "frogs.csv", {"AFrog": TYPES})
    assert kept.read_text() == "of a user"


def test_a_table_of_parts_is_no_pipe_and_keeps_a_link(tmp_path):
    pipe, link = tmp_path / "pipe.csv", tmp_path / "link.csv"
    os.mkfifo(pipe)
    with pytest.raises(MisuseError, match="it is a pipe or a device; choose a file name"):
        TableParts(pipe, {"AFrog": TYPES})
    (tmp_path / "elsewhere").mkdir()
    link.symlink_to(tmp_path / "elsewhere" / "frogs.csv")
    parts = TableParts(link, {"AFrog": TYPES})
    writer = parts.open(PLAN)
    writer.rows(rows(0))
    writer.close()
    parts.join()
    assert link.is_symlink()
    assert content(link) == content(written(tmp_path / "whole.csv", [rows(0)]))


def test_a_run_leaves_no_parts_and_tables_without_rows_have_a_file(tmp_path):
    collect = {"n": count(Frog), "old": data(Frog, "age").where("age > 100")}
    run(pond(), frames=3, collect=collect, into=tmp_path / "out.csv")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out-AFrog.csv", "out-frames.csv"]
    assert (tmp_path / "out-AFrog.csv").read_text() == "frame,id,old\n"


@pytest.mark.parametrize("reason", [(28, "No space left on device"), ("no room",)])
def test_tables_that_a_disk_does_not_take_do_not_end_the_world(
    tmp_path, monkeypatch, capfd, reason
):
    save, into = TableParts.save, tmp_path / "out.csv"

    def full(parts):
        if any(parts.folder.glob("*.columns")):
            raise OSError(*reason)
        save(parts)

    monkeypatch.setattr(TableParts, "save", full)
    monkeypatch.setattr("minerva_bus.launch.run_outputs.SAVE_SECONDS", 0.0)
    lacks = "it may lack rows of the last 0 s before frame 2, and has no later ones"
    with pytest.raises(MinervaError, match=rf"tables: .*out\.csv \({reason[-1]}; {lacks}\)"):
        run(pond(), frames=3, collect={"n": count(Frog)}, into=into)
    # The rows that it had taken are kept.
    assert [*tmp_path.iterdir()] == [into]
    assert into.read_text() == "frame,time,n\n0,0.0,3\n"
    assert f"the rows that were saved are in {into}" in capfd.readouterr().err


def test_tables_of_parts_are_described(tmp_path):
    parts = TableParts(tmp_path / "out.csv", {"AFrog": {"frame": "int64", "x": "float64"}})
    about = json.loads((parts.folder / "tables.json").read_text())
    assert about == {"AFrog": {"frame": "int64", "x": "float64"}}
