"""`minerva sweep`: all combinations, once each, despite interruptions."""

import csv
import json
import os
import signal
import subprocess
import sys
import time

import pytest

from extensions.study.tests.ponds import pond
from minerva_bus.cli.main import app
from minerva_bus.errors import MinervaError, MisuseError
from minerva_bus.settings.world_settings import Overrides
from minerva_study.comparison import draw_comparison, shown
from minerva_study.grid import parse_grid
from minerva_study.journal import StudyJournal
from minerva_study.results import ResultTable, Row, write
from minerva_study.sweep_runs import Sweep

NEVER_THE_SAME = "seconds"


def sweep(world, *words, start=False):
    command = [sys.executable, "-m", "minerva_bus", "sweep", str(world), *words]
    if start:
        return subprocess.Popen(
            command,
            cwd=world.parent,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, "TMPDIR": str(world.parent)},
        )
    return subprocess.run(command, cwd=world.parent, capture_output=True, text=True)


def rows(path):
    with path.open(newline="") as file:
        table = list(csv.DictReader(file))
    for row in table:
        del row[NEVER_THE_SAME]
    return table


# --- combinations ---


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("n=1,2,3", ("1", "2", "3")),
        ("n=0:4", ("0", "1", "2", "3")),
        ("n=0:1:0.25", ("0.0", "0.25", "0.5", "0.75")),
        ("n=0.50,1", ("0.5", "1")),
        ("n=astar,random", ("astar", "random")),
        ("n=-1:2,9", ("-1", "0", "1", "9")),
        ("n=[1, 2],[3]", ("[1, 2]", "[3]")),
        ('n="a,b","c"', ("a,b", "c")),
        ("n=1,x,3:5", ("1", "x", "3", "4")),
        ("n=true", ("true",)),
        ("n=", ("",)),
    ],
)
def test_values_of_a_key(text, values):
    assert parse_grid([text]).values["n"] == values


@pytest.mark.parametrize(
    ("settings", "problem"),
    [
        (["n"], "expected KEY=VALUE"),
        (["=1"], "expected KEY=VALUE"),
        (["n=1", "n=2"], "n is already set"),
        (["n=1,1.0,1"], "is given twice"),
        (["n=3:1"], "empty"),
        (["n=0:1:0"], "empty"),
        (["n=0:1e9"], "values"),
        (["seed=x"], "is not a whole number"),
        (["a=0:10000", "b=0:10000"], "too many"),
    ],
)
def test_an_invalid_grid_is_rejected_in_one_line(settings, problem):
    with pytest.raises(MisuseError, match=problem) as raised:
        parse_grid(settings)
    assert "\n" not in str(raised.value)


def test_combinations_name_options_settings_and_the_seed():
    grid = parse_grid(["wood=oak,elm", "buds.processes=2", "seed=0:2"])
    assert list(grid) == [
        ("oak", "2", "0"), ("oak", "2", "1"), ("elm", "2", "0"), ("elm", "2", "1"),
    ]  # fmt: skip
    made = grid.overrides(("elm", "2", "1"), Overrides({"vigour": "1"}, frames=7))
    assert made.options == {"vigour": "1", "wood": "elm"}
    assert made.settings == ("buds.processes=2",)
    assert made.values == {"seed": 1, "frames": 7, "rate": 0.0}


# --- the journal ---


def test_a_journal_cut_off_anywhere_keeps_all_lines_that_are_whole(tmp_path):
    path = tmp_path / "j"
    with StudyJournal(path, {"world": "w"}) as journal:
        journal.add({"set": ["1"]})
        journal.add({"set": ["2"]})
    whole = path.read_bytes()
    second = whole.rindex(b"\n", 0, -1) + 1
    for cut in range(second, len(whole)):
        path.write_bytes(whole[:cut])
        with StudyJournal(path, {"world": "w"}) as journal:
            assert journal.lines == [{"set": ["1"]}]
            journal.add({"set": ["3"]})
        assert path.read_bytes() == whole[:second] + b'{"set": ["3"]}\n'


def test_a_journal_of_another_study_or_process_is_refused(tmp_path):
    path = tmp_path / "j"
    with StudyJournal(path, {"world": "w"}), pytest.raises(MisuseError, match="another process"):
        StudyJournal(path, {"world": "w"})
    with pytest.raises(MisuseError, match="another study; different: world w, now v; remove it"):
        StudyJournal(path, {"world": "v"})
    path.write_text("garbage\n")
    with pytest.raises(MisuseError, match="j:1: not a line"):
        StudyJournal(path, {"world": "w"})


@pytest.mark.parametrize("content", [
    b"notes", b"notes\nand more", b'{"world": "v"}\nan end', b'{"world": "w"}\nnotes\nan end', b"\0",
    b'{"world": "w"} and more',
])  # fmt: skip
def test_a_file_that_no_sweep_has_written_stays_as_it_is(tmp_path, content):
    path = tmp_path / "j"
    path.write_bytes(content)
    with pytest.raises(MisuseError, match=r"j(:1|:2)?: .*(not a line of a journal|another study)"):
        StudyJournal(path, {"world": "w"})
    assert path.read_bytes() == content


def test_a_journal_whose_first_line_was_cut_off_begins_again(tmp_path):
    path = tmp_path / "j"
    StudyJournal(path, {"world": "w"}).__exit__(None, None, None)
    whole = path.read_bytes()
    for cut in range(len(whole)):
        path.write_bytes(whole[:cut])
        with StudyJournal(path, {"world": "w"}) as journal:
            assert journal.lines == []
        assert path.read_bytes() == whole


def test_a_line_that_no_sweep_has_written_is_named(tmp_path):
    study, path = Sweep(pond(tmp_path), parse_grid(["seed=0:2"]), Overrides()), tmp_path / "j"
    good = {"set": ["0"], "error": "", "seconds": 1.0, "outcome": OUTCOME, "figures": {}}
    wrong = [
        {}, {"set": 1}, {"set": [[]]}, {"set": []}, {"set": "0"}, {"seconds": "x"},
        {"seconds": 10**400}, {"outcome": None}, {"outcome": {}}, {"outcome": {**OUTCOME, "frames": "5"}},
        {"figures": []}, {"error": None}, {"error": "failed"},
    ]  # fmt: skip
    for change in wrong:
        line = {**good, **change} if change else {}
        path.unlink(missing_ok=True)
        with StudyJournal(path, study.description) as journal:
            journal.add(line)
        with (
            StudyJournal(path, study.description) as journal,
            pytest.raises(MisuseError, match="j:2: not a line of a journal; remove it"),
        ):
            study.recall(journal)


def test_a_journal_that_cannot_be_used_is_named(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    path = tmp_path / "j"
    path.write_text("[" * 100_000 + "\n")
    with pytest.raises(MisuseError, match="j:1: not a line"):
        StudyJournal(path, {"world": "w"})
    path.unlink()
    with StudyJournal(path, {"world": "w"}) as journal, monkeypatch.context() as patched:
        patched.setattr(os, "write", full)
        with pytest.raises(MisuseError, match="j: cannot be written: No space left"):
            journal.add({"set": ["1"]})
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(MisuseError, match="pipe: a pipe or device"):
        StudyJournal(tmp_path / "pipe", {"world": "w"})


# --- tables ---

OUTCOME = {"frames": 5, "digest": "12e4", "ended": "the frames are over", "reached": True}

ROWS = [
    Row(("1", "oak"), {"frames": 5, "digest": "12e4", "reached": True}, {"x": 1}, "", 1.0),
    Row(("2", "elm"), {"frames": 6, "digest": "0001"}, {"x": 2.5, "error": 3}, "", 1.0),
    Row(("3", "007x"), error="it, failed", seconds=2.0),
]


def test_a_csv_table(tmp_path):
    write(ResultTable.of(("n", "digest"), ROWS), tmp_path / "t.csv")
    assert (tmp_path / "t.csv").read_text() == (
        "n,digest_,frames,digest,ended,reached,error_,x,error,seconds\n"
        "1,oak,5,12e4,,true,,1,,1.0\n"
        "2,elm,6,0001,,,3,2.5,,1.0\n"
        '3,007x,,,,,,,"it, failed",2.0\n'
    )
    assert [path.name for path in tmp_path.iterdir()] == ["t.csv"]


def test_a_parquet_table_has_types(tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    write(ResultTable.of(("n", "wood"), ROWS), tmp_path / "t.parquet")
    read = parquet.read_table(tmp_path / "t.parquet").to_pydict()
    assert read["n"] == [1, 2, 3]
    assert read["wood"] == ["oak", "elm", "007x"]
    assert read["x"] == [1.0, 2.5, None]
    assert read["digest"] == ["12e4", "0001", None]


def test_a_table_for_people_has_the_means_over_the_seeds(tmp_path):
    made = [
        Row((wood, seed), {"frames": 5}, {"grown": grown})
        for wood, seed, grown in (("oak", "0", 1.0), ("oak", "1", 2.0), ("elm", "0", 3))
    ]
    table = ResultTable.of(("wood", "seed"), [*made, Row(("elm", "1"), error="it failed")])
    assert shown(table) == [
        "wood          runs  frames       grown",
        " oak             2       5  1.5 (1..2)",
        " elm  1 (1 failed)       5           3",
    ]
    pytest.importorskip("matplotlib")
    draw_comparison(table, "pond", tmp_path / "p.svg")
    assert "<svg" in (tmp_path / "p.svg").read_text()


# --- the command ---


def test_a_sweep_that_was_killed_goes_on_to_the_same_table(tmp_path):
    world = pond(tmp_path)
    words = ("--set", "vigour=0.5,1.0", "--set", "seed=0:4", "--in-process", "--workers", "1")
    assert sweep(world, *words, "-o", "whole.csv").returncode == 0
    running = sweep(world, *words, "-o", "killed.csv", start=True)
    journal = tmp_path / "killed.csv.journal"
    while not journal.exists() or journal.read_bytes().count(b"\n") < 3:
        assert running.poll() is None, running.communicate()
        time.sleep(0.005)
    running.send_signal(signal.SIGKILL)
    running.communicate()
    done = journal.read_bytes()
    again = sweep(world, *words, "-o", "killed.csv")
    assert again.returncode == 0, again.stderr
    assert "runs are in killed.csv.journal already" in again.stderr
    assert journal.read_bytes().startswith(done[: done.rindex(b"\n")])
    assert rows(tmp_path / "killed.csv") == rows(tmp_path / "whole.csv")
    assert len({row["digest"] for row in rows(tmp_path / "whole.csv")}) == 8
    fewer = sweep(world, *words[:2], "--set", "seed=0:3", "--in-process", "-o", "killed.csv")
    assert fewer.stdout.splitlines()[-1] == "6 runs are in killed.csv"
    assert len(rows(tmp_path / "killed.csv")) == 6
    assert journal.read_bytes().count(b"\n") == 9


def test_over_the_bus_and_alone_the_rows_are_the_same_and_failures_are_named(tmp_path):
    world = pond(tmp_path)
    words = ("--set", "wood=oak", "--set", "vigour=0.5,4.0", "--json")
    over = sweep(world, *words, "-o", "bus.csv")
    alone = sweep(world, *words, "-o", "alone.csv", "--in-process")
    assert (over.returncode, alone.returncode) == (1, 1)
    fine, burst = rows(tmp_path / "bus.csv")
    assert fine == rows(tmp_path / "alone.csv")[0]
    assert "burst" in burst["error"]
    answer = json.loads(over.stdout)
    assert answer["failed"][0]["set"] == {"wood": "oak", "vigour": "4.0"}
    assert answer["runs"] == 2


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        (("--set", "vigor=1"), "did you mean '--vigour'"),
        (("--set", "vigour=1", "-o", "x.xlsx"), "expected a name that ends in .parquet or .csv"),
        (("--set", "vigour=1", "-o", "no/x.csv"), "there is no folder"),
        (("--set", "vigour=1", "-o", "old.csv"), "without its journal"),
    ],
)
def test_an_invalid_sweep_is_rejected_in_one_line(tmp_path, monkeypatch, words, problem):
    world = pond(tmp_path)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "old.csv").write_text("mine")
    with pytest.raises(MinervaError) as raised:
        app(["sweep", str(world), *words], standalone_mode=False)
    assert problem in str(raised.value)
    assert "\n" not in str(raised.value)
    assert (tmp_path / "old.csv").read_text() == "mine"
    assert not list(tmp_path.glob("*.journal"))
