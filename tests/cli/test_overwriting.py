"""Commands do not overwrite files that the program did not write, including derived names."""

import os
import re
import signal
import stat
import sys

import pytest

from minerva_bus import files as outputs
from minerva_bus.cli.main import main

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


def minerva(*words):
    """Run a command in this process; returns its exit code."""
    argv, handler = sys.argv, signal.getsignal(signal.SIGTERM)
    sys.argv = ["minerva", *words]
    try:
        main()
    except SystemExit as end:
        return end.code or 0
    finally:
        sys.argv = argv
        signal.signal(signal.SIGTERM, handler)
    return 0


def run(*words):
    return minerva("run", "robot", "--in-process", "--frames", "3", *words)


def test_the_picture_beside_a_view_is_not_the_map(house, capfd):
    before = (house / "house.png").read_bytes()
    words = ("--map", "house.yaml", "--objective", "A", "--view", "svg:path=house.svg,every=1")
    assert run(*words) == 2
    assert "house.png" in (errors := capfd.readouterr().err)
    assert "--force" in errors
    assert len(errors.splitlines()) == 1
    assert (house / "house.png").read_bytes() == before
    assert not (house / "house.svg").exists()
    assert run(*words, "--force") == 0
    assert (house / "house.png").read_bytes() != before


@pytest.mark.parametrize("path", [
    "house.svg", "new/../house.svg", "./house.svg", "linked/house.svg", "linked/../{name}/house.svg",
    "other.svg", "hard.svg", "deep/../new/../house.svg",
])  # fmt: skip
def test_no_other_name_of_the_map_is_overwritten(house, capfd, path):
    (house / "linked").symlink_to(house)
    (house / "deep").mkdir()
    (house / "other.png").symlink_to("house.png")
    (house / "hard.png").hardlink_to(house / "house.png")
    before = (house / "house.png").read_bytes()
    path = path.format(name=house.name)
    assert run("--map", "house.yaml", "--view", f"svg:path={path},every=1") == 2
    assert "--force" in capfd.readouterr().err
    assert (house / "house.png").read_bytes() == before
    # It is refused before the world starts, so no folder is made either.
    assert not (house / "new").exists()


def test_a_run_overwrites_what_an_earlier_run_wrote(house):
    for _ in range(2):
        assert run("--view", "svg:path=out.svg,every=1", "--record", "out.mcap") == 0
    assert minerva("plot", "out.mcap") == 0
    assert minerva("plot", "out.mcap") == 0


@pytest.mark.parametrize("name", ["mine.mcap", "mine.old.mcap"])
def test_a_record_takes_no_users_file_away(house, capfd, name):
    assert run("--record", "mine.mcap") == 0
    (house / name).write_bytes(b"another tool's")
    assert run("--record", "mine.mcap") != 0
    assert f"{name} exists" in capfd.readouterr().err
    assert (house / name).read_bytes() == b"another tool's"


def test_a_plot_does_not_overwrite_a_users_picture(house, capfd):
    assert run("--record", "house.mcap") == 0
    before = (house / "house.png").read_bytes()
    assert minerva("plot", "house.mcap") != 0
    assert "house.png exists" in capfd.readouterr().err
    assert (house / "house.png").read_bytes() == before
    assert minerva("plot", "house.mcap", "--force") == 0


@pytest.mark.parametrize(("words", "name"), [
    (("--record-video", "out.mp4"), "out.mp4"),
    (("--view", "sound:path=out.wav,voice=PRobot"), "out.wav"),
    (("--view", "svg:path=out.svg,every=1"), "out.svg"),
    (("--record", "out.mcap"), "out.mcap"),
    (("--collect", "robots=count(ARobot)", "--into", "out.csv"), "out.csv"),
])  # fmt: skip
def test_no_output_waits_for_a_pipe_without_a_reader(house, capfd, words, name):
    os.mkfifo(house / name)
    assert run(*words) == 2
    errors = capfd.readouterr().err
    assert re.search(
        f"no program reads the pipe {name}|write {name}: it is a pipe or a dev", errors
    )
    assert len(errors.splitlines()) == 1
    assert stat.S_ISFIFO((house / name).stat().st_mode)


@pytest.mark.parametrize(("words", "name"), [
    (("--record-video", "out.gif"), "out.gif"),
    (("--collect", "robots=count(ARobot)", "--into", "out.parquet"), "out.parquet"),
])  # fmt: skip
def test_a_record_is_not_overwritten_under_another_name(house, capfd, words, name):
    assert run("--record", "run.mcap") == 0
    before = (house / "run.mcap").read_bytes()
    (house / name).symlink_to("run.mcap")
    assert run(*words) == 2
    assert f"{name} exists and was not written" in capfd.readouterr().err
    assert (house / "run.mcap").read_bytes() == before
