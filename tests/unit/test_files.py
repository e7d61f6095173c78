"""Files of any name, kind and size: inputs, and outputs that overwrite no other file."""

import io
import os
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from minerva_agents.robot.maps import load_map
from minerva_bus import files, record, resume
from minerva_bus.errors import MinervaError, MisuseError
from minerva_bus.files import (
    check_ending,
    check_file,
    check_output,
    check_replaceable,
    ending_of,
    is_own,
    note_read,
    path_of_text,
    read_text,
    replacing,
    text_of_path,
    write_output,
)
from minerva_bus.launch.installed import declared_options, file_text
from minerva_bus.launch.world_files import read_world_file
from minerva_bus.log import chunks
from minerva_bus.log.chunks import Chunks
from minerva_services.options import read_password

SPARSE = 64 << 30
"""Bytes of a file that takes no space on the disk, but hours or all memory to read."""


@pytest.fixture
def sparse(tmp_path):
    path = tmp_path / "sparse.toml"
    with path.open("wb") as file:
        file.truncate(SPARSE)
    return path


READERS = {
    "a world": read_world_file,
    "the options of a world": lambda path: declared_options(str(path)),
    "a string": file_text,
    "a map": load_map,
    "a password": lambda path: read_password("mqtt", "", str(path)),
}


@pytest.mark.parametrize("what", READERS)
def test_a_huge_file_is_refused_by_its_size(what, sparse, monkeypatch):
    monkeypatch.setattr(Path, "read_bytes", lambda path: pytest.fail("read"))
    monkeypatch.setattr(Path, "read_text", lambda path, **_: pytest.fail("read"))
    with pytest.raises(MinervaError, match=r"68.?719.?476.?736 bytes"):
        READERS[what](sparse)


@pytest.mark.parametrize("begin", [b"", chunks.MAGIC])
def test_a_record_of_unwritten_bytes_is_not_searched_to_its_end(begin, sparse, monkeypatch):
    monkeypatch.setattr(chunks, "MAX_DAMAGE", 1 << 20)
    with sparse.open("r+b") as file:
        file.write(begin)
    with pytest.raises(MinervaError, match="no record of an MCAP file in 1,048,576 bytes"):
        Chunks(sparse)


@pytest.mark.parametrize("name", ["a.png", "A.PNG", "a.Png"])
def test_an_ending_names_its_format_in_any_case(name):
    check_ending(Path(name), (".svg", ".png"), "picture")
    assert ending_of(name) == ".png"
    with pytest.raises(MisuseError, match=r"expected a name that ends in \.csv$"):
        check_ending(Path(name), (".csv",), "table")


def test_folders_and_pipes_are_named(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path, reason in ((tmp_path, "a folder"), (tmp_path / "pipe", "a pipe or device")):
        with pytest.raises(OSError, match=reason):
            read_text(path)


TEXTS = (".svg", ".html", ".yaml", ".toml", ".mnv", ".mmd")
SVG = b"<svg xmlns='http://www.w3.org/2000/svg'/>\n"


@pytest.fixture(autouse=True)
def _a_process_of_its_own(monkeypatch):
    monkeypatch.setattr(files, "_policy", files._Policy())


def image(suffix):
    from io import BytesIO

    from PIL import Image

    content = BytesIO()
    Image.new("L", (3, 2), 200).save(content, {".pgm": "ppm"}.get(suffix, suffix[1:]))
    return content.getvalue()


def test_a_missing_file_is_compared_with_those_beside_it(tmp_path):
    for name in ("rain.mcap", "rain.toml", "run.mcap"):
        (tmp_path / name).touch()
    assert files.similar(tmp_path / "rian.mcap") == "; did you mean 'rain.mcap'?"
    assert files.similar(tmp_path / "rian.toml") == "; did you mean 'rain.toml'?"
    assert files.similar(tmp_path / "rain.mcap") == ""
    assert files.similar(tmp_path / "nowhere" / "rain.mcap") == ""


@pytest.mark.parametrize(
    ("forced", "remedy"), [(None, "delete it"), (False, "overwrite it with --force")]
)
def test_a_users_file_is_not_overwritten(forced, remedy, tmp_path, monkeypatch):
    monkeypatch.setattr(files._policy, "forced", forced)
    path = tmp_path / "house.svg"
    path.write_bytes(SVG)
    with pytest.raises(MisuseError, match=rf"house\.svg exists and was not written by .*{remedy}"):
        write_output(path, b"<svg/>", "picture")
    assert path.read_bytes() == SVG
    assert [file.name for file in tmp_path.iterdir()] == ["house.svg"]


@pytest.mark.parametrize("suffix", TEXTS)
def test_a_text_file_is_the_programs_until_it_is_edited(tmp_path, suffix):
    path = tmp_path / f"out{suffix}"
    for content in (b"first\n", b"second, without an end of line"):
        write_output(path, content)
        assert path.read_bytes().startswith(content)
    path.write_bytes(path.read_bytes().replace(b"second", b"my own"))
    with pytest.raises(MisuseError, match="has been edited"):
        check_output(path)


def test_an_error_of_writing_names_the_file_and_leaves_none(tmp_path):
    with pytest.raises(OSError, match="No space") as caught, replacing(tmp_path / "a.svg"):
        raise OSError(28, "No space left on device")
    assert caught.value.filename == str(tmp_path / "a.svg")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", [".png", ".pgm", ".gif"])
def test_a_marked_image_reads_as_the_same_image_and_may_be_replaced(tmp_path, suffix):
    from PIL import Image

    path = tmp_path / f"out{suffix}"
    for _ in range(2):
        write_output(path, image(suffix))
    with Image.open(path) as read:
        assert (read.size, read.convert("L").getpixel((0, 0))) == ((3, 2), 200)
    path.write_bytes(image(suffix))
    assert not is_own(path)


def test_a_pdf_is_recognised(tmp_path):
    figure = pytest.importorskip("matplotlib.figure")
    content, path = io.BytesIO(), tmp_path / "plot.pdf"
    figure.Figure().savefig(content, format="pdf")
    for _ in range(2):
        write_output(path, content.getvalue())
    assert path.read_bytes().startswith(b"%PDF")


def test_an_input_is_not_overwritten_even_if_the_program_wrote_it(tmp_path):
    path, link = tmp_path / "best.toml", tmp_path / "link.toml"
    write_output(path, b"[world]\n")
    link.symlink_to(path)
    note_read(path)
    for name in (path, link, tmp_path / "." / "best.toml"):
        with pytest.raises(MisuseError, match="is an input of this run"):
            check_output(name)
    check_replaceable(path)  # its content is kept under another name


def test_force_overwrites(tmp_path):
    path = tmp_path / "house.svg"
    path.write_bytes(SVG)
    note_read(path)
    files.force_overwriting(True)
    write_output(path, b"<svg/>\n")
    assert path.read_bytes().startswith(b"<svg/>")


def test_missing_and_empty_files_and_devices_may_be_written(tmp_path):
    check_output(tmp_path / "new.svg")
    (tmp_path / "empty.svg").touch()
    check_output(tmp_path / "empty.svg")
    write_output(tmp_path / "empty.svg", SVG)
    device = tmp_path / "null.svg"
    device.symlink_to("/dev/null")
    write_output(device, SVG)
    assert device.is_symlink()


def test_a_link_stays_and_names_the_new_file(tmp_path):
    (tmp_path / "elsewhere").mkdir()
    target, link = tmp_path / "elsewhere" / "house.svg", tmp_path / "house.svg"
    link.symlink_to(target)
    for content in (SVG, b"<svg/>"):
        write_output(link, content)
        assert link.is_symlink()
        assert target.read_bytes().startswith(content)
    assert [path.name for path in (tmp_path / "elsewhere").iterdir()] == ["house.svg"]


@pytest.mark.parametrize("forced", [False, True])
def test_a_pipe_without_a_reader_is_refused_and_waits_for_none(tmp_path, forced):
    files.force_overwriting(forced)
    pipe = tmp_path / "pipe.svg"
    os.mkfifo(pipe)
    with pytest.raises(
        MisuseError, match=r"no program reads the pipe .*pipe\.svg; start its reader"
    ):
        write_output(pipe, SVG)
    with pytest.raises(MisuseError, match="it is a pipe or a device; choose a file name"):
        check_file(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    try:
        write_output(pipe, SVG)
        assert os.read(reader, 100) == SVG
        # It is not at its end until the process is, as further pictures may follow.
        with pytest.raises(BlockingIOError):
            os.read(reader, 100)
    finally:
        os.close(reader)
        for kept in files._policy.pipes.values():
            os.close(kept)


def test_a_record_is_the_programs_under_the_name_of_a_record_only(tmp_path):
    record = tmp_path / "run.mcap"
    record.write_bytes(b"\x89MCAP0\r\n....minerva-bus 0.5.0")
    (tmp_path / "run.mp4").symlink_to(record)
    check_output(record)
    with pytest.raises(MisuseError, match="was not written by Minerva Bus"):
        check_output(tmp_path / "run.mp4")


def test_a_folder_is_no_output(tmp_path):
    with pytest.raises(MisuseError, match="is a folder"):
        check_output(tmp_path)


def test_a_folder_that_takes_no_file_is_reported_before_the_work(tmp_path, monkeypatch):
    check_output(tmp_path / "new" / "house.svg")
    exists = Path.exists
    # As on a disk for reading only, which refuses root, too.
    monkeypatch.setattr(os, "access", lambda path, mode: exists(path) and mode == os.F_OK)
    message = f"picture: cannot write .*house.svg: the folder {tmp_path} is not writable"
    for path in (tmp_path / "house.svg", tmp_path / "new" / "house.svg"):
        with pytest.raises(MisuseError, match=message):
            check_output(path, "picture")


def test_a_file_that_cannot_be_written_reports_why_and_leaves_nothing(tmp_path):
    with pytest.raises(MisuseError, match=r"picture: cannot write .*No such file"):
        write_output(tmp_path / "nowhere" / "a.svg", SVG, "picture")
    assert not any(tmp_path.iterdir())


CODE = """
from minerva_bus import Disc, EventType, Primitive
PSpot = Primitive("PSpot", Disc(0.2, "#8a5a44"), x=float, y=float)
eTick = EventType("eTick")
ePicture = EventType("ePicture", visual=True)
"""
WORLD = """
[world]
string = "PSpot<x=1, y=1>"
vocabulary = ["odd_spot:PSpot", "odd_spot:eTick", "odd_spot:ePicture"]
frames = 3
[process.ticks]
service = "each"
event = "eTick"
[process.picture]
service = "svg"
path = "picture.svg"
"""


@pytest.fixture
def odd(tmp_path, monkeypatch):
    """A folder with a world, whose name is not UTF-8."""
    folder = tmp_path / os.fsdecode(b"odd\xff")
    folder.mkdir()
    (folder / "odd_spot.py").write_text(CODE)
    (folder / "spot.toml").write_text(WORLD)
    monkeypatch.chdir(folder)
    monkeypatch.setattr(sys, "path", [str(folder), *sys.path])
    return folder


@given(st.binary(min_size=1, max_size=40).filter(lambda name: b"\0" not in name))
def test_the_text_of_each_path_is_utf_8_and_leads_back_to_it(name):
    path = os.fsdecode(name)
    text = text_of_path(path)
    assert text.encode().decode() == text
    try:
        name.decode()
    except UnicodeDecodeError:
        assert "\\x" in text
    else:
        assert os.fspath(path_of_text(text)) == os.path.normpath(path)


@pytest.mark.skipif(sys.platform != "linux", reason="macOS refuses such names")
@pytest.mark.parametrize("bus", [False, True])
def test_a_world_runs_and_is_recorded_in_a_folder_of_such_a_name(odd, bus):
    path, kept = odd / "spot.toml", odd / "spot.mcap"
    done = record(path, kept, bus=bus)
    assert done.figures["picture"].endswith(".png") or done.figures["picture"].endswith(".svg")
    assert resume(kept, path, frames=5, bus=bus).frames == 5
