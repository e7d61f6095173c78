"""Data collected from runs: expressions, tables, files, and exchange with other libraries."""

import csv
import math
import sys

import numpy as np
import pytest
from frogs import Frog, eCroak, eCross, pond, race

from minerva_bus import MinervaError, World, count, data, each, on, run
from minerva_bus.api.running import pick_table
from minerva_bus.collect.data_tables import DataTable, create_writer, read_columns
from minerva_bus.collect.plans import condition_of, read_entries, read_expression
from minerva_bus.errors import MisuseError, VocabularyError
from minerva_bus.log.record import Record
from minerva_bus.world.expressions import Expression

TYPES = {"frame": "int64", "x": "float64", "on": "bool", "name": "text"}


def table():
    names = np.array(["é", "", "long text"], object)
    return DataTable("t", TYPES, {
        "frame": np.array([1, 2, 3]), "x": np.array([0.5, math.nan, 3.0]),
        "on": np.array([True, False, True]), "name": names,
    })  # fmt: skip


@pytest.mark.parametrize(("text", "expression"), [
    ("AFrog.x", Frog.x),
    ("AFrog.x every 10", Frog.x.every(10)),
    ('AFrog.x where mood == "loud" every 2', Frog.x.where('mood == "loud"').every(2)),
    ("count(AFrog)", count(Frog)),
    ("count(AFrog, x > 1 and age < 3)", count(Frog, "x > 1 and age < 3")),
    ("mean(AFrog.x)", Frog.x.mean()),
    ("sum(AFrog.age, hungry == true)", Frog.age.sum("hungry == true")),
    ("quantiles(AFrog.x, 0.1, 0.9)", Frog.x.quantiles(0.1, 0.9)),
    ("histogram(AFrog.x, 0, 60, 12, age > 1)", Frog.x.histogram(0, 60, 12, where="age > 1")),
    ("AFrog where age > 3", data(Frog).where("age > 3")),
    ("eCroak", data(eCroak)),
    ("eCroak.loud", data(eCroak, "loud")),
    ("max(eCroak.loud)", data(eCroak, "loud").max()),
    ("count(eCroak)", count(eCroak)),
])  # fmt: skip
def test_expressions_and_their_texts_are_the_same(text, expression):
    assert read_expression(text) == expression
    assert str(expression) == text


@pytest.mark.parametrize(("text", "problem"), [
    ("averge(AFrog.x)", "no function averge"),
    ("mean(AFrog)", "which attribute of AFrog"),
    ("count(AFrog x > 1)", "cannot be read"),
    ("AFrog.x if x > 1", "cannot be read"),
    ("quantiles(AFrog.x, 2)", "from 0 to 1"),
    ("histogram(AFrog.x, 3, 1, 5)", "low < high"),
    ("frogs", "cannot be read"),
    ("histogram(AFrog.x, -1e999, 3, 5)", "finite"),
    ("histogram(AFrog.x, 0, 1, 1e999)", "finite"),
    ("histogram(AFrog.x, 0, inf, 5)", "finite"),
    ("quantiles(AFrog.x, nan)", "from 0 to 1"),
    ("mean(AFrog.x, 3)", "mean of AFrog takes no numbers"),
])  # fmt: skip
def test_texts_that_are_no_expression_are_shown_with_a_caret(text, problem):
    with pytest.raises(VocabularyError, match=problem) as caught:
        read_expression(text)
    assert "^" in str(caught.value)


@pytest.mark.parametrize("expression", [
    Frog.x.quantiles(0.1 + 0.2, 1 / 3, 5e-324),
    Frog.x.quantiles(*np.array([0.1, 0.9])),
    Frog.x.histogram(-0.5, 2**53 + 1, 3),
    Frog.x.histogram(-1e300, 10**22, 3),
    Frog.x.histogram(-(2**70), -1e-7, 3),
    Frog.x.where(r'mood == "say \"a\\b\", it\'s every 3"').every(2),
    count(Frog, r"""mood == 'it\'s "a\\"' and x > -1.5"""),
])  # fmt: skip
def test_texts_of_expressions_are_read_as_the_same_expression(expression):
    assert read_expression(str(expression)) == expression


@pytest.mark.parametrize(("text", "value"), [
    (r"'it\'s'", "it's"),
    ("'say \"hi\"'", 'say "hi"'),
    (r"'a\\'", "a\\"),
    (r"""'\"\\"'""", '"\\"'),
    (r"'\u00e9\n'", "é\n"),
    (r'"it' "'" r's \"b\""', "it's \"b\""),
])  # fmt: skip
def test_texts_in_conditions_may_have_quotes_and_backslashes(text, value):
    condition = f"mood == {text} and x > 1"
    for expression in (count(Frog, condition), read_expression(f"count(AFrog, {condition})")):
        assert condition_of(expression, pond().vocabulary).comparisons[0].right == value


@pytest.mark.parametrize(
    "number", [math.inf, -math.inf, math.nan, pytest.param(10**400, id="large"), "few"]
)
def test_arguments_of_expressions_are_finite_numbers(number):
    for make in (
        lambda: Frog.x.quantiles(number),
        lambda: Frog.x.histogram(number, 3),
        lambda: Frog.x.histogram(0, number),
        lambda: Frog.x.histogram(0, 3, number),
    ):
        with pytest.raises(MisuseError, match="of AFrog must be finite numbers"):
            make()


@pytest.mark.parametrize(("collect", "problem"), [
    ({"x": "AFrog.y"}, "AFrog has no y"),
    ({"x": "AFog.x"}, "no agent kind AFog; did you mean 'AFrog'"),
    ({"x": "eCrok.loud"}, "no event type eCrok"),
    ({"x": 3}, "such as Person.x"),
    ({"m": Frog.mood.mean()}, "is a text, which has no mean"),
    ({"n": count(Frog, "mod == 'x'")}, "no mod"),
    ({"frame": count(Frog)}, "two columns 'frame'"),
    ("x", "expected names with expressions"),
])  # fmt: skip
def test_what_cannot_be_collected_is_said_before_the_run(collect, problem):
    with pytest.raises(MinervaError, match=problem):
        run(pond(), frames=1, collect=collect)


def test_frames_agents_and_events_have_a_table_each():
    done = run(pond(), frames=6, seed=3, collect={
        "frogs": count(Frog), "loud": count(Frog, "mood == 'loud'"), "age": Frog.age.sum(),
        "mid": Frog.size.quantiles(0.5), "sizes": Frog.size.histogram(0, 4, 2),
        "croaks": count(eCroak), "x": Frog.x, "mood": Frog.mood, "croak": data(eCroak),
        "late": Frog.age.where("age > 2").every(3),
    })  # fmt: skip
    frames = done.table()
    assert frames["frame"].tolist() == list(range(7))
    assert frames["time"].tolist() == pytest.approx([0.1 * n for n in range(7)])
    assert frames["frogs"].tolist() == [3] * 7
    assert frames["loud"].tolist() == [0, 3, 0, 3, 0, 3, 0]
    assert frames["age"].tolist() == [0, 3, 6, 9, 12, 15, 18]
    assert frames["mid_0.5"].tolist() == [2.0] * 7
    assert (frames["sizes_0"][0], frames["sizes_1"][0]) == (1, 2)
    # An event that is sent in frame t is processed in frame t + 1.
    assert frames["croaks"].tolist() == [0, 0, 0, 3, 0, 0, 3]
    agents = done.table("AFrog")
    assert agents["id"].tolist()[:4] == ["a", "b", "c", "a"]
    assert len(agents) == 21
    assert done.table("x") is agents
    last = {row[1]: row[2] for row in agents.rows() if row[0] == 6}
    assert f"x={last['a']!r}" in str(done.scene)
    assert done.table("AFrog_late")["frame"].tolist() == [3, 3, 3, 6, 6, 6]
    croaks = done.table("eCroak")
    assert set(croaks["sender"]) == {"a", "b", "c"}
    assert croaks.columns == ("frame", "sender", "receiver", "loud")
    with pytest.raises(MisuseError, match="no table 'y'"):
        done.table("y")


def test_an_empty_table_of_frames_is_returned_without_a_name():
    empty = DataTable("frames", {"frame": "int64"}, {"frame": np.array([], np.int64)})
    assert pick_table({"eCroak": table(), "frames": empty}, "") is empty
    assert pick_table({"frames": empty, "eCroak": table()}, "") is empty


def test_aggregates_of_nothing():
    collect = {"n": count(Frog, "x > 1e9"), "sum": Frog.age.sum("x > 1e9"),
               "mean": Frog.x.mean("x > 1e9"), "q": Frog.x.quantiles(0.5, where="x > 1e9")}  # fmt: skip
    done = run(pond(), frames=1, collect=collect).table()
    assert (done["n"][0], done["sum"][0]) == (0, 0)
    assert np.isnan(done["mean"]).all()
    assert np.isnan(done["q_0.5"]).all()


def test_columns_and_nodes_give_the_same_rows():
    class Bird(type(Frog("z"))):  # The same kind, in a string large enough for columns.
        pass

    singles = World(
        Frog.many("f", 8, size=2.0), agents=[Frog], services=[each("eTick")], name="few"
    )
    population = World(Frog.many("f", 100, size=2.0), agents=[Frog], services=[each("eTick")])
    for world, number in ((singles, 8), (population, 100)):
        done = run(world, frames=2, collect=[Frog.size, Frog.mood, Frog.hungry])
        rows = done.table()
        assert len(rows) == 3 * number
        assert rows["id"].tolist()[:number] == [f"f{n}" for n in range(number)]
        assert rows["size"].tolist() == [2.0] * len(rows)
        assert rows["hungry"].all()
        assert rows["mood"].tolist() == ["calm"] * number + ["loud"] * number + ["calm"] * number


def test_an_attribute_of_a_class_is_an_expression_and_of_an_agent_its_value():
    assert Frog.x == Expression("AFrog", "x")
    frog = Frog("a", size=2.0)
    assert (frog.size, frog.mood) == (2.0, "calm")
    del frog.mood
    assert frog.mood == "calm"  # Deletion restores the class default, as in plain Python.
    with pytest.raises(MinervaError, match="has been deleted"):
        frog.freeze()

    class Toad(Frog, symbol="AToad"):
        warts: int = 3

    assert str(Toad.size) == "AToad.size"
    assert str(Frog.size) == "AFrog.size"
    assert Toad("t").warts == 3


def test_names_of_entries():
    assert list(read_entries([Frog.x, data(eCroak)])) == ["x", "eCroak"]
    with pytest.raises(MisuseError, match="twice"):
        read_entries([Frog.x, Frog.x])


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_a_run_goes_into_files(tmp_path, ending, monkeypatch):
    if ending == "parquet":
        pytest.importorskip("pyarrow")
    monkeypatch.setattr("minerva_bus.collect.data_tables.BUFFERED_ROWS", 5)
    collect = {"frogs": count(Frog), "x": Frog.x, "mood": Frog.mood}
    path = tmp_path / f"pond.{ending}"
    done = run(pond(), frames=6, seed=1, collect=collect, into=path)
    here = run(pond(), frames=6, seed=1, collect=collect)
    with pytest.raises(MisuseError, match="in the file"):
        done.table()
    agents = tmp_path / f"pond-AFrog.{ending}"
    if ending == "csv":
        rows = [tuple(row) for row in csv.reader(agents.open(encoding="utf-8"))]
        assert rows[0] == here.table("AFrog").columns
        assert [tuple(map(str, row)) for row in here.table("AFrog").rows()] == rows[1:]
    else:
        parquet = pytest.importorskip("pyarrow.parquet")
        assert parquet.read_table(agents).to_pydict() == {
            name: here.table("AFrog")[name].tolist() for name in here.table("AFrog").columns
        }
    assert (tmp_path / f"pond-frames.{ending}").exists()


def test_a_foreign_file_is_not_overwritten(tmp_path):
    path = tmp_path / "mine.csv"
    path.write_text("precious\n")
    with pytest.raises(MisuseError, match=r"a \.csv file has no mark"):
        run(pond(), frames=1, collect=[Frog.x], into=path)
    with pytest.raises(MisuseError, match=r"\.parquet or \.csv"):
        run(pond(), frames=1, collect=[Frog.x], into=tmp_path / "x.xls")


def test_columns_files_are_read_as_they_were_written(tmp_path):
    path = tmp_path / "t.columns"
    writer = create_writer(path, TYPES)
    writer.rows(table().to_dict())
    writer.row({"frame": 4, "x": 1.0, "on": False, "name": "z"})
    writer.close()
    loaded = read_columns(path, "t", TYPES)
    assert loaded["name"].tolist() == ["é", "", "long text", "z"]
    assert loaded["frame"].tolist() == [1, 2, 3, 4]
    assert loaded["on"].dtype == np.bool_


def test_columns_files_keep_every_character(tmp_path):
    path = tmp_path / "t.columns"
    names = ["a\0", "\0", "", "$", "é\0\0", "$\0$"]
    writer = create_writer(path, {"name": "text"})
    writer.rows({"name": np.array(names, object)})
    writer.close()
    assert read_columns(path, "t", {"name": "text"})["name"].tolist() == names


def test_arrow_reads_a_table():
    pa = pytest.importorskip("pyarrow")
    arrow = pa.table(table())
    assert arrow.schema.names == list(TYPES)
    assert arrow.column("frame").to_pylist() == [1, 2, 3]
    assert arrow.column("on").to_pylist() == [True, False, True]
    assert arrow.column("name").to_pylist() == ["é", "", "long text"]
    assert arrow.column("x").to_pylist()[::2] == [0.5, 3.0]
    assert arrow.schema.types == [pa.int64(), pa.float64(), pa.bool_(), pa.large_string()]
    assert table().to_arrow().schema == arrow.schema
    empty = DataTable("e", TYPES, {name: table()[name][:0] for name in TYPES})
    assert pa.table(empty).num_rows == 0
    arrow.validate(full=True)


def test_a_table_names_the_extra_that_gives_arrow(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(MisuseError, match=r"this needs pyarrow: .*\[parquet\]"):
        table().__arrow_c_stream__()
    with pytest.raises(MisuseError, match=r"this needs pyarrow: .*\[parquet\]"):
        table().to_arrow()


@pytest.mark.parametrize("library", ["pandas", "polars"])
def test_other_libraries_read_a_table(library):
    pytest.importorskip(library)
    frame = getattr(table(), f"to_{library}")()
    assert list(frame.columns) == list(TYPES)
    assert list(frame["name"]) == ["é", "", "long text"]


def test_a_missing_library_is_named_with_its_command(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pandas", None)
    with pytest.raises(MisuseError, match=r"pip install 'minerva-bus\[pandas\]'"):
        table().to_pandas()


def test_world_files_collect(tmp_path):
    path = tmp_path / "pond.toml"
    into = tmp_path / "pond.csv"
    saved = pond(collect={"frogs": count(Frog), "loud": count(Frog, "mood == 'loud'")})
    saved.save(path)
    assert "loud = \"count(AFrog, mood == 'loud')\"" in path.read_text()
    done = run(path, frames=2)
    assert done.table()["loud"].tolist() == [0, 3, 0]
    run(path, frames=2, into=into)
    assert into.read_text().splitlines()[1] == "0,0.0,3,0"


def test_a_file_of_an_unknown_format_is_said_before_the_run(tmp_path):
    path = tmp_path / "pond.toml"
    path.write_text(pond().toml() + '\n[collect]\ninto = "x.xls"\nn = "count(AFrog)"\n')
    with pytest.raises(MinervaError, match=r"pond.toml:\d+:\d+: collect.into must end with"):
        World.load(path)


def test_a_wrong_table_of_a_world_file_names_its_line(tmp_path):
    path = tmp_path / "pond.toml"
    path.write_text(pond().toml() + '\n[collect]\nfrogs = "count(AFog)"\n')
    with pytest.raises(VocabularyError, match=r"pond.toml:\d+: collect.frogs.*no agent kind AFog"):
        World.load(path)


def test_an_agent_with_a_handler_named_like_nothing_else_is_untouched():
    class Newt(Frog, symbol="ANewt"):
        @on("eTick")
        def live(self, tick, moment):
            self.age += 2

    world = World("ANewt#n", agents=[Newt], services=[each("eTick")])
    assert run(world, frames=3, collect=[Newt.age]).table()["age"].tolist() == [0, 2, 4, 6]


CROSSED = {"crossed": count(eCross), "rows": data(eCross)}


@pytest.mark.parametrize(("racer", "settings"), [
    ("anna", {"until": "eCross"}), ("anna", {"frames": 3}), ("ghost", {}),
    ("anna", {"until": "eCross", "processes": 1}),
])  # fmt: skip
def test_events_that_agents_send_in_the_last_frame_count(tmp_path, racer, settings):
    path = tmp_path / "race.mcap"
    done = run(race(racer), collect=CROSSED, record=path, **{"frames": 9, **settings})
    assert (done.frames, done.events) == (3, {"eCross": 1, "eTick": 3})
    assert done.tables["frames"]["crossed"].tolist() == [0, 0, 0, 1]
    assert done.tables["eCross"]["frame"].tolist() == [3]
    with Record(path) as record:
        events = *(frame.events for frame in record.frames()), record.closing_events()
        assert [len(each) for each in events] == [1] * 4


def test_they_count_in_a_world_that_is_stopped():
    with race("anna").start(collect=CROSSED) as live:
        live.step(3)
    assert live.table("frames")["crossed"].tolist() == [0, 0, 0, 1]


def test_agents_of_the_present_string_are_selected():
    every = {"frogs": data(Frog).where("x > 0")}
    done = run(pond(), frames=4, seed=3, collect=every)
    with pond().start(seed=3) as live:
        live.step(4)
        frogs = live.agents(Frog, "x > 0")
        again = done.agents("AFrog", "x > 0")
        assert 0 < len(frogs) < len(live.agents(Frog))
        for wrong, problem in ((("AFrg",), "did you mean 'AFrog'"), ((Frog, "y > 0"), "has no y")):
            with pytest.raises(VocabularyError, match=problem):
                live.agents(*wrong)
        with pytest.raises(MisuseError, match="expected an agent class"):
            live.agents(eCroak)
    assert frogs.columns == ("frame", "id", "x", "size", "age", "hungry", "mood")
    collected = done.table()
    last = collected["frame"] == 4
    for name in frogs.columns:
        assert list(frogs[name]) == list(again[name]) == list(collected[name][last])
