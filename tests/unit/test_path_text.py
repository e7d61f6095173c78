"""Paths with bytes that are not UTF-8: Linux allows them, messages and records do not."""

import os
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from minerva_bus import record, resume
from minerva_bus.path_text import path_of_text, text_of_path

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
