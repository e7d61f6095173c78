"""Pictures, films and tables, and their texts in a terminal."""

import re
import signal
import sys
import time
import xml.etree.ElementTree as ET

import pytest
from balls import Ball, Bell, balls, bells, eBroken, ePicture
from frogs import pond
from PIL import Image

from minerva_bus import Interrupted, connect, count, record, run
from minerva_bus.api import pictures
from minerva_bus.errors import MisuseError
from minerva_bus.launch import child_processes
from minerva_bus.log.record import Record
from minerva_bus.world.agent import ActivityError

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(autouse=True)
def own_runtime_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("MINERVA_RUNTIME_DIR", str(tmp_path / "runtime"))


def circles(svg):
    """The centres of the discs of a picture, metres from its lower left corner."""
    return [
        (float(disc.get("cx")), float(disc.get("cy")))
        for disc in ET.fromstring(svg).find(f"{SVG}g").iter(f"{SVG}circle")
    ]


def test_a_picture_shows_the_last_string():
    done = run(balls(), frames=4)
    svg = done.picture().svg
    (ax, ay), (bx, by) = circles(svg)
    assert (bx - ax, by - ay) == (0.0, 3.0)
    assert "frame 4" in svg
    assert done.picture(ePicture).svg == svg
    assert 'width="300"' in done.picture(width=300).svg


def test_a_picture_is_saved_and_an_edited_file_is_kept(tmp_path):
    path = tmp_path / "balls.svg"
    picture = run(balls(), frames=4).picture()
    picture.save(path)
    assert circles(path.read_text(encoding="utf-8")) == circles(picture.svg)
    path.write_text("my own drawing", encoding="utf-8")
    with pytest.raises(MisuseError, match="was not written by Minerva Bus"):
        picture.save(path)


def test_the_ending_of_a_file_names_its_format(tmp_path):
    pytest.importorskip("resvg_py")
    done = run(balls(), frames=2, film=1, collect={"balls": count(Ball)})
    done.picture().save(tmp_path / "balls.png")
    picture = tmp_path / "balls.png"
    with Image.open(picture) as image:
        image.verify()
        assert (image.format, image.info["Software"]) == ("PNG", "Made by Minerva Bus")
    expected = r"cannot write .*balls.*: expected a name that ends in "
    for save, endings in [
        (done.picture().save, ".svg or .png"),
        (done.film().save, ".html"),
        (done.table().to_csv, ".csv"),
        (done.table().to_parquet, ".parquet"),
        (balls().save, ".toml"),
    ]:
        for wrong in ("jpg", ""):
            with pytest.raises(MisuseError, match=expected + re.escape(endings)):
                save(tmp_path / f"balls.{wrong}")
    assert [*tmp_path.glob("balls*")] == [picture]


def test_a_picture_as_png_names_what_is_missing(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "minerva_services.views.svg.rendering", None)
    with pytest.raises(MisuseError, match=r"pip install 'minerva-bus\[picture\]'"):
        run(balls(), frames=1).picture().save(tmp_path / "balls.png")


def test_a_world_without_forms_is_explained():
    done = run(pond(), frames=2)
    with pytest.raises(MisuseError, match="pond has no pictures: no primitive has a form"):
        done.picture()


def test_a_view_that_fails_or_is_unknown_is_explained():
    done = run(balls(), frames=2)
    with pytest.raises(ActivityError):
        done.picture(eBroken)
    with pytest.raises(MisuseError, match="no event type ePikture; did you mean 'ePicture'"):
        done.picture("ePikture")
    with pytest.raises(MisuseError, match="eTick is not visual"):
        done.picture("eTick")


def test_a_film_has_every_nth_frame_and_the_last_one_in_one_frame_of_view(monkeypatch, capsys):
    done = run(balls(), frames=7, film=3, quiet=True)
    film = done.film()
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    assert done.film() == film
    lines = capsys.readouterr().err.split("\r\x1b[2K")
    assert [line.split()[-1] for line in lines if line] == ["1/4", "2/4", "3/4", "4/4"]
    assert lines[-1] == ""
    assert [picture.frame for picture in film.pictures] == [0, 3, 6, 7]
    # In a common part of the world the discs move by metres.
    assert [circles(picture.svg)[0][0] - circles(film.pictures[0].svg)[0][0]
            for picture in film.pictures] == [0, 3, 6, 7]  # fmt: skip
    assert repr(film) == "<Film of balls: 4 pictures, frames 0 to 7>"


def test_a_film_on_the_bus_is_the_same(tmp_path):
    here = run(balls(), frames=7, film=3).film()
    assert run(balls(), frames=7, film=3, bus=True).film() == here
    path = tmp_path / "balls.mcap"
    assert run(balls(), frames=7, film=3, bus=True, record=path).film() == here
    assert path.exists()


def test_without_a_package_that_displays_films_they_cannot_be_saved(monkeypatch):
    monkeypatch.setattr(pictures, "entries", lambda group: {})
    film = run(balls(), frames=2, film=1).film()
    assert film._repr_mimebundle_() == {"text/plain": repr(film)}
    with pytest.raises(MisuseError, match="no package that displays films is installed"):
        film.save("balls.html")


def test_without_a_film_the_message_names_the_argument():
    with pytest.raises(MisuseError, match=r"run\(world, film=10\)"):
        run(balls(), frames=2).film()
    with pytest.raises(MisuseError, match="film must be a whole number from 0, not -1"):
        run(balls(), frames=2, film=-1)


def test_a_terminal_shows_a_line():
    done = run(balls(), frames=2, collect={"balls": count(Ball)})
    assert re.fullmatch(
        r"<Run of balls: 2 frames in [\d.]+ s; the frames are over; digest \w{8}…; tables: frames>",
        repr(done),
    )
    with balls().start() as live:
        live.step(2)
        assert repr(live) == f"<Live balls; frame 2; digest {done.digest[:8]}…>"
    assert repr(live).endswith("the world has ended>")


def test_a_live_picture_shows_the_current_string():
    with balls().start() as live:
        live.step(3)
        assert live.picture() == run(balls(), frames=3).picture()


def test_a_connected_world_has_pictures_if_the_classes_are_known():
    with balls().start(bus=True) as live:
        live.step(3)
        with connect("balls", agents=[Ball]) as known:
            assert known.picture() == live.picture()
        with connect("balls") as unknown, pytest.raises(MisuseError, match="class of ABall"):
            unknown.picture()


def test_a_table_displays_its_first_rows_escaped():
    done = run(balls(), frames=20, collect={"x": Ball.x})
    table = done.table()
    html = table._repr_html_()
    root = ET.fromstring(html)
    rows = [[cell.text for cell in row] for row in root.iter("tr")]
    assert rows[0] == ["frame", "id", "x"]
    assert rows[1:] == [[str(frame), id, str(frame)] for frame in range(5) for id in "ab"]
    assert root.find("p").text == "and 32 more rows"
    short = run(balls(), frames=2, collect={"a<b": count(Ball)}).table()
    assert "<th>a&lt;b</th>" in short._repr_html_()
    assert "more" not in short._repr_html_()


def test_an_interrupted_run_ends_after_its_frame_with_tables_and_record(tmp_path):
    path = tmp_path / "bells.mcap"
    with pytest.raises(Interrupted, match="bells was interrupted after 6 frames") as error:
        record(bells(), path, frames=0, collect={"bells": count(Bell)}, film=2)
    done = error.value.run
    assert (done.frames, done.ended, len(done.table())) == (6, "interrupted", 7)
    assert [frame for frame, _ in done.kept] == [0, 2, 4, 6]
    with Record(path) as recorded:
        assert max(frame.number for frame, _ in recorded.strings()) == 5


def test_an_interrupt_also_ends_a_frame_that_does_not_end(monkeypatch):
    monkeypatch.setattr(child_processes, "FRAME_SECONDS", 0.01)
    monkeypatch.setattr(Bell, "after", staticmethod(lambda: time.sleep(60)))
    with pytest.raises(Interrupted, match="bells was interrupted after 5 frames"):
        run(bells(), frames=0)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
