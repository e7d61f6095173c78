"""`minerva plot`: the data of its figures, and drawing them."""

import io
import sys
from pathlib import Path

import numpy as np
import pytest

from extensions.analysis.tests.test_table_files import swept
from minerva_analysis.places import Surveyor
from minerva_analysis.plot_command import plot_file
from minerva_analysis.plotting import LABEL_HEIGHT, label_ends
from minerva_analysis.tables import read_table
from minerva_analysis.tracks import MAX_AGENTS, _Sampler, story_of
from minerva_bus import Agent, Default, Degrees, Metres, Motion, Transformation, Vocabulary
from minerva_bus.cli.main import app
from minerva_bus.errors import MinervaError, MisuseError
from minerva_bus.frame.world_state import WorldSpec
from minerva_bus.log.entries import RecordHeader
from minerva_bus.log.record_writer import RecordWriter
from tests.log.recorded_runs import bytes_of, happened, record_of, strings_of

mcap = pytest.importorskip("mcap")

TAt = Transformation(
    "TAt", Motion("x", "y", "turn"), x=Metres, y=Metres, turn=Default(Degrees, 0.0)
)


class Walker(Agent, symbol="AWalker"):
    x: Metres
    y: Metres
    heading: Degrees = 0.0


class Mole(Agent, symbol="AMole"):
    row: int
    column: int
    cell: float = 0.5
    x0: float = 10.0


class Seeker(Agent, symbol="ASeeker"):
    x: Metres
    y: Metres
    objective: str = ""


class Name(Agent, symbol="AName"):
    x: str = "here"
    y: str = "there"


class Wind(Agent, symbol="AWind"):
    x: float
    y: float
    vx: float = 0.0
    vy: float = 1.0


WORLD = Vocabulary.of(TAt, Walker, Mole, Name, Wind)


def where(text, most=0):
    places = Surveyor(WORLD, most).places(WORLD.read(text))
    return {
        kind: [
            tuple(round(v, 6) for v in row)
            for row in zip(track.x, track.y, track.angle, strict=True)
        ]
        for kind, track in places.items()
    }


def test_places_by_the_names_of_attributes():
    text = (
        "AWalker#a<x=1, y=2, heading=30> · AMole#m<row=4, column=6> · AName#n · AWind#w<x=3, y=4>"
    )
    assert where(text) == {"AWalker": [(1, 2, 30)], "AMole": [(12, 3, 0)], "AWind": [(3, 4, 90)]}


def test_transformations_around_an_agent_move_it():
    text = "TAt<x=5, y=0, turn=90>(AWalker#a<x=1, y=2>(AWalker#b<x=0, y=0>)) · AWalker#c<x=0, y=0>"
    assert where(text) == {"AWalker": [(3, 1, 90), (5, 0, 90), (0, 0, 0)]}
    text = "TAt<x=5, y=0>(TAt<x=0, y=7>(AWalker#a<x=0, y=0>) · AWalker#b<x=1, y=0>)"
    assert where(text) == {"AWalker": [(5, 7, 0), (6, 0, 0)]}


def test_columns_are_the_agents_they_stand_for():
    walkers = Walker.many("w", 40, x=np.arange(40.0), y=np.ones(40))
    places = Surveyor(WORLD).places(walkers)["AWalker"]
    single = Surveyor(WORLD).places(WORLD.read(str(walkers)))["AWalker"]
    assert list(places.ids) == list(single.ids)
    assert places.x.tolist() == single.x.tolist()
    assert len(Surveyor(WORLD, 10).places(walkers)["AWalker"].ids) == 10


def draw(record, output):
    plot_file(record, output, (), "", "", bars=False, as_json=False)


@pytest.mark.parametrize("name", ["meadow", "flock", "robot"])
def test_tracks_are_where_agents_were(name, tmp_path):
    strings = strings_of(name)
    vocabulary = happened(name)[0].world.vocabulary
    with record_of(bytes_of(name), tmp_path) as record:
        story = story_of(record)
    assert len(story.times) == len(strings)
    followed = Surveyor(vocabulary).places(strings[-1])
    assert followed
    for columns in followed.values():
        for agent, x, y in zip(columns.ids, columns.x, columns.y, strict=True):
            track = story.tracks[agent]
            assert (track.x[-1], track.y[-1], track.times[-1]) == (x, y, story.times[-1])
            assert story.is_there(track)
    assert len(story.events) == len(story.seconds) == len(strings) - 1


def test_the_distance_has_a_gap_without_an_objective(tmp_path, monkeypatch):
    monkeypatch.setattr("minerva_analysis.tracks.labels", lambda *_: {"kitchen": (0.0, 0.0)})
    world = Vocabulary.of(TAt, Seeker)
    sampler = _Sampler(world.read(""), world)
    for time, goal in enumerate(("", "kitchen", "", "kitchen")):
        sampler.sample(time, world.read(f'ASeeker#a<x=3, y=4, objective="{goal}">'))
    times, metres = sampler.distances["a"]
    assert times == [1, 2, 3]
    np.testing.assert_equal(metres, [5.0, np.nan, 5.0])


def test_the_distance_to_the_objective(tmp_path):
    with record_of(bytes_of("robot"), tmp_path) as record:
        story = story_of(record)
    [(agent, (times, metres))] = story.distances.items()
    track = story.tracks[agent]
    robot = next(node for node in strings_of("robot")[-1].nodes if getattr(node, "id", "") == agent)
    places_of = {
        node.scope.nodes[0].parameters["name"]: (node.parameters["x"], node.parameters["y"])
        for node in strings_of("robot")[0].nodes
        if node.symbol == "TPlace" and node.scope.nodes[0].symbol == "PMarker"
    }
    x, y = story.goals[agent]
    assert (x, y) == places_of[robot.state["objective"]]
    assert metres[-1] == pytest.approx(((track.x[-1] - x) ** 2 + (track.y[-1] - y) ** 2) ** 0.5)
    assert len(times) == len(metres)


@pytest.mark.parametrize("name", ["meadow", "flock", "robot"])
def test_a_picture(name, tmp_path, capsys):
    pytest.importorskip("matplotlib")
    path = tmp_path / "run.mcap"
    path.write_bytes(bytes_of(name, finished=False))
    draw(path, None)
    assert capsys.readouterr().out.strip() == str(tmp_path / "run.png")
    assert (tmp_path / "run.png").read_bytes()[:4] == b"\x89PNG"


def test_a_picture_that_cannot_be_written(tmp_path):
    pytest.importorskip("matplotlib")
    path = tmp_path / "run.mcap"
    path.write_bytes(bytes_of("robot"))
    with pytest.raises(MinervaError, match="there is no folder"):
        draw(path, tmp_path / "none" / "run.png")
    with pytest.raises(MinervaError, match=r"run\.docx: expected a name that ends in \.png"):
        draw(path, tmp_path / "run.docx")


def test_without_matplotlib(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    path = tmp_path / "run.mcap"
    path.write_bytes(bytes_of("robot"))
    with pytest.raises(MisuseError, match=r"pip install 'minerva-bus\[plot\]'"):
        draw(path, None)


def test_a_world_without_places_or_frames(tmp_path):
    pytest.importorskip("matplotlib")
    world = WorldSpec("names", WORLD.read("AName#n"), WORLD)
    stream = io.BytesIO()
    RecordWriter(stream, RecordHeader(world)).finish()
    path = tmp_path / "run.mcap"
    path.write_bytes(stream.getvalue())
    draw(path, tmp_path / "run.svg")
    assert (tmp_path / "run.svg").stat().st_size > 1000


def test_a_notebook_displays_the_picture_of_a_table_that_the_command_writes(tmp_path):
    swept().to_csv(tmp_path / "swept.csv")
    words = ["plot", str(tmp_path / "swept.csv"), "--series", "n", "--x", "frame"]
    app(words, standalone_mode=False)
    plot = read_table(tmp_path / "swept.csv").plot("n", x="frame")
    plot.save(tmp_path / "own.png")
    written = (tmp_path / "swept.png").read_bytes()
    assert (tmp_path / "own.png").read_bytes() == written
    picture, size = plot._repr_png_()
    assert size == {"width": 816, "height": 403}
    # The file has a mark, the picture on the page has none.
    assert picture[-1000:] == written[-1000:]
    assert repr(plot) == "<Plot of swept: save(path) writes a .png, .svg, .pdf file>"
    with pytest.raises(MisuseError, match=r"cannot write .*own\.tab"):
        plot.save(tmp_path / "own.tab")


def test_the_command_plots_a_table(tmp_path, capsys):
    swept().to_csv(tmp_path / "t.csv")
    app(["plot", str(tmp_path / "t.csv"), "--series", "n, size"], standalone_mode=False)
    assert capsys.readouterr().out == f"{tmp_path}/t.png\n"
    assert (tmp_path / "t.png").read_bytes().startswith(b"\x89PNG")
    for ending in ("gif", "txt"):
        with pytest.raises(
            MisuseError, match=r"expected a name that ends in \.png, \.svg or \.pdf"
        ):
            app(
                ["plot", "run.mcap", "--output", str(tmp_path / f"t.{ending}")],
                standalone_mode=False,
            )
    with pytest.raises(MisuseError, match="--collect is of records"):
        app(["plot", str(tmp_path / "t.csv"), "--collect", "count(A)"], standalone_mode=False)


def test_the_document_has_the_limits_of_followed_agents():
    document = (Path(__file__).parents[1] / "replay.md").read_text(encoding="utf-8")
    assert f"about {MAX_AGENTS} in all" in document


@pytest.mark.parametrize("scale", ["linear", "log"])
def test_names_of_lines_that_end_close_together_are_apart(scale):
    axis = pytest.importorskip("matplotlib.figure").Figure().subplots()
    axis.set(yscale=scale, ylim=(1, 1000))
    label_ends(axis, [(999, "a", "#000000"), (990, "b", "#000000"), (2, "c", "#000000")])
    heights = {text.get_text(): text.xy[1] for text in axis.texts}
    assert LABEL_HEIGHT / 2 <= heights["b"] <= heights["a"] - LABEL_HEIGHT + 1e-9
    assert heights["a"] < 1
    assert 0 < heights["c"] < 0.15
