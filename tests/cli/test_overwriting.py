"""Commands do not overwrite files that the program did not write, including derived names."""

import os
import re
import stat

import pytest

from minerva_bus import files as outputs
from tests.runtime.running import here

pytest.importorskip("PIL")

MAP = "image: house.png\nresolution: 0.1\norigin: [0, 0, 0]\nnegate: 0\n"
MAP += "occupied_thresh: 0.65\nfree_thresh: 0.196\nmarkers: {A: [2.5, 1.5]}\nstart: [1, 1, 0]\n"


@pytest.fixture
def house(tmp_path, monkeypatch):
    """A folder with a map drawn by a user."""
    from PIL import Image, ImageDraw

    monkeypatch.setattr(outputs, "_policy", outputs._Policy())
    monkeypatch.chdir(tmp_path)
    drawn = Image.new("L", (40, 30), 254)
    ImageDraw.Draw(drawn).rectangle((0, 0, 39, 29), outline=0)
    drawn.save("house.png")
    (tmp_path / "house.yaml").write_text(MAP)
    return tmp_path


def run(house, *words):
    return here(house, "run", "robot", "--in-process", "--frames", "3", *words)


def test_the_picture_beside_a_view_is_not_the_map(house):
    before = (house / "house.png").read_bytes()
    words = ("--map", "house.yaml", "--objective", "A", "--view", "svg:path=house.svg,every=1")
    done = run(house, *words)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "house.png" in done.stderr
    assert "--force" in done.stderr
    assert (house / "house.png").read_bytes() == before
    assert not (house / "house.svg").exists()
    assert run(house, *words, "--force").returncode == 0
    assert (house / "house.png").read_bytes() != before


@pytest.mark.parametrize("path", [
    "house.svg", "new/../house.svg", "./house.svg", "linked/house.svg", "linked/../{name}/house.svg",
    "other.svg", "hard.svg", "deep/../new/../house.svg",
])  # fmt: skip
def test_no_other_name_of_the_map_is_overwritten(house, path):
    (house / "linked").symlink_to(house)
    (house / "deep").mkdir()
    (house / "other.png").symlink_to("house.png")
    (house / "hard.png").hardlink_to(house / "house.png")
    before = (house / "house.png").read_bytes()
    path = path.format(name=house.name)
    done = run(house, "--map", "house.yaml", "--view", f"svg:path={path},every=1")
    assert (done.returncode, "--force" in done.stderr) == (2, True)
    assert (house / "house.png").read_bytes() == before
    # It is refused before the world starts, so no folder is made either.
    assert not (house / "new").exists()


def test_a_run_overwrites_what_an_earlier_run_wrote(house):
    for _ in range(2):
        done = run(house, "--view", "svg:path=out.svg,every=1", "--record", "out.mcap")
        assert done.returncode == here(house, "plot", "out.mcap").returncode == 0


@pytest.mark.parametrize("name", ["mine.mcap", "mine.old.mcap"])
def test_a_record_takes_no_users_file_away(house, name):
    assert run(house, "--record", "mine.mcap").returncode == 0
    (house / name).write_bytes(b"another tool's")
    done = run(house, "--record", "mine.mcap")
    assert (done.returncode != 0, f"{name} exists" in done.stderr) == (True, True)
    assert (house / name).read_bytes() == b"another tool's"


def test_a_plot_does_not_overwrite_a_users_picture(house):
    assert run(house, "--record", "house.mcap").returncode == 0
    before = (house / "house.png").read_bytes()
    done = here(house, "plot", "house.mcap")
    assert (done.returncode != 0, "house.png exists" in done.stderr) == (True, True)
    assert (house / "house.png").read_bytes() == before
    assert here(house, "plot", "house.mcap", "--force").returncode == 0


@pytest.mark.parametrize(("words", "name"), [
    (("--record-video", "out.mp4"), "out.mp4"),
    (("--view", "sound:path=out.wav,voice=PRobot"), "out.wav"),
    (("--view", "svg:path=out.svg,every=1"), "out.svg"),
    (("--record", "out.mcap"), "out.mcap"),
    (("--collect", "robots=count(ARobot)", "--into", "out.csv"), "out.csv"),
])  # fmt: skip
def test_no_output_waits_for_a_pipe_without_a_reader(house, words, name):
    os.mkfifo(house / name)
    done = run(house, *words)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    said = f"no program reads the pipe {name}|write {name}: it is a pipe or a dev"
    assert re.search(said, done.stderr)
    assert stat.S_ISFIFO((house / name).stat().st_mode)


@pytest.mark.parametrize(("words", "name"), [
    (("--record-video", "out.gif"), "out.gif"),
    (("--collect", "robots=count(ARobot)", "--into", "out.parquet"), "out.parquet"),
])  # fmt: skip
def test_a_record_is_not_overwritten_under_another_name(house, words, name):
    assert run(house, "--record", "run.mcap").returncode == 0
    before = (house / "run.mcap").read_bytes()
    (house / name).symlink_to("run.mcap")
    done = run(house, *words)
    assert (done.returncode, f"{name} exists and was not written" in done.stderr) == (2, True)
    assert (house / "run.mcap").read_bytes() == before
