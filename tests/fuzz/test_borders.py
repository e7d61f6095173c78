"""Small but expensive input, non-finite numbers, and paths outside their folder."""

import math
import struct
import sys
import zlib
from contextlib import nullcontext
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path

import msgpack
import numpy as np
import pytest

from minerva_agents.robot.grid import MapError
from minerva_agents.robot.maps import load_map
from minerva_services.bridges.mqtt.rules import Pattern
from minerva_services.sensors.laser import Laser

sys.path.append(str(Path(__file__).parents[1] / "runtime"))
import yard
from running import here, write_world

from minerva_bus.errors import (
    GrammarError,
    MisuseError,
    ProtocolError,
    VocabularyError,
    WorldFileError,
)
from minerva_bus.frame import messages as m
from minerva_bus.grammar.parser import parse
from minerva_bus.launch.world_files import read_world_file
from minerva_bus.wire.codec import Decoder, encode
from minerva_bus.wire.keys import checked_name
from minerva_bus.world.readings import Battery, Image, Odometry, Scan

DECODER = Decoder(yard.vocabulary)
NO_NUMBERS = pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf], ids=str)


def heard(*message):
    return DECODER.from_member("a", msgpack.packb(list(message)))


# --- external maps ---

KEYS = "resolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.2\n"


@pytest.mark.parametrize(
    "bomb",
    [
        "a: &a [x, x]\nb: &b [*a, *a]\nc: &c [*b, *b]\nimage: [*c, *c]\n",
        "image: &a [*a]\n",
        "[" * 20_000,
        "? " * 5_000,
        "image: !!python/object/apply:os.system ['true']\n",
    ],
    ids=["aliases", "itself", "lists", "keys", "code"],
)
def test_a_map_that_would_grow_as_it_is_read_is_refused(tmp_path, bomb):
    (tmp_path / "map.yaml").write_text(bomb + KEYS)
    with pytest.raises(MapError, match=r"map\.yaml: "):
        load_map(tmp_path / "map.yaml")


def png(width, height):
    """A PNG file with a declared size and almost no data."""

    def chunk(kind, data):
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    head = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    body = zlib.compress(bytes(100_000))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", body) + chunk(b"IEND", b"")


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("map.pgm", b"P5 999999999 999999999 255\n" + bytes(64)),
        ("map.pgm", b"P2 50000 50000 255\n0 0 0\n"),
        ("map.png", png(60_000, 60_000)),
    ],
)
def test_an_image_with_a_huge_declared_size_is_rejected_before_allocation(tmp_path, name, data):
    pytest.importorskip("PIL")
    (tmp_path / name).write_bytes(data)
    with pytest.raises(MapError, match=r"pixels"):
        load_map(tmp_path / name)


def test_a_camera_image_with_a_huge_declared_size_is_ignored():
    pytest.importorskip("cv2")
    from minerva_services.sensors.vision.images import NoImage, grey_of

    with pytest.raises(NoImage):
        grey_of(Image("r", png(60_000, 60_000), "png", 60_000, 60_000, 0.0))


# --- patterns ---


def test_patterns_take_no_longer_than_they_are_long():
    levels = 2_000
    pattern = Pattern.of("/".join(["+"] * levels) + "/end")
    assert pattern.levels("/" * 60_000) is None
    assert pattern.levels("/".join(["x"] * levels) + "/End") is None
    assert (
        Pattern.of("/".join(["{a}", *["+"] * levels, "#"])).levels("a/" * levels + "a") is not None
    )
    assert not fnmatchcase("a" * 64 + "b", "*a" * 40 + "c")  # a rule of [placement]


def test_an_invalid_key_is_located_fast_in_a_long_file(tmp_path):
    path = write_world(tmp_path, "[process.x]\nagents = 'yard:Walker'\n")
    path.write_text("\n" * 200_000 + path.read_text().replace("seed =", "sead ="))
    with pytest.raises(WorldFileError, match=r":20000\d:1: .*sead is unknown"):
        read_world_file(path)


# --- non-finite numbers ---


@NO_NUMBERS
def test_infinite_numbers_never_enter_a_string(number):
    with pytest.raises(VocabularyError, match="finite"):
        heard("ticked", 1, [["eCall", [number]]], None)
    with pytest.raises((VocabularyError, ProtocolError), match="finite"):
        heard("evolved", 1, 0, {"a": [1, ["AWalker", "a", [number, 0, "", 0], 0]]}, {}, {})
    with pytest.raises(GrammarError):
        parse(f"AWalker#a<x={number}>")


@NO_NUMBERS
def test_infinite_numbers_are_no_readings(number):
    for reading in (
        Odometry("r", number, 0.0, 0.0, 0.0, 0.0, 0.0),
        Battery("r", number, 12.0, 0.0),
        Scan("r", np.ones(3, np.float32), number, 1.0, 10.0, 0.0),
    ):
        with pytest.raises(ProtocolError, match="finite"):
            DECODER.readings("scan", "a", encode(m.Readings("a", "scan", 1, (reading,))))


@pytest.mark.parametrize(
    ("beams", "step", "range_max", "problem"),
    [
        (3, 0.0, 10.0, "0 degrees apart"),
        (3, -0.0, 10.0, "0 degrees apart"),
        (1, 0.0, 10.0, ""),
        (3, 1.0, 0.0, "range_max of a scan is 0"),
        (0, 1.0, -1.0, "range_max of a scan is -1"),
    ],
)
def test_scans_without_directions_or_a_range_are_no_readings(beams, step, range_max, problem):
    scan = Scan("r", np.ones(beams, np.float32), 0.0, step, range_max, 0.0)
    message = encode(m.Readings("a", "scan", 1, (scan, replace(scan, beam_time=0.1))))
    with pytest.raises(ProtocolError, match=problem) if problem else nullcontext():
        DECODER.readings("scan", "a", message)


def test_beams_without_a_number_hit_nothing():
    laser = Laser()
    laser._obstacle = lambda dist, angle, receivers: (dist, angle)
    beams = np.array([math.nan, 1.0, math.inf, -math.inf], np.float32)
    tick = type("Tick", (), {"readings": (Scan("r", beams, 0.0, 90.0, 10.0, 0.0),)})
    assert list(laser.generate(tick)) == [(1.0, 90.0)]


@pytest.mark.parametrize("key", ["rate", "dt"])
@pytest.mark.parametrize("number", ["nan", "inf", "-inf"])
def test_a_world_s_numbers_are_finite(tmp_path, key, number):
    path = write_world(tmp_path, "[process.x]\nagents = 'yard:Walker'\n", dt=0.25, rate=1)
    value = {"dt": "0.25", "rate": "1"}[key]
    path.write_text(path.read_text().replace(f"{key} = {value}\n", f"{key} = {number}\n"))
    done = here(tmp_path, "check", path)
    assert done.returncode != 0
    assert key in done.stdout + done.stderr


# --- names ---


def test_a_duplicate_id_is_rejected():
    walker = ["AWalker", "a", [0.0, 0, "", 0], 0]
    with pytest.raises(ProtocolError, match="two agents have the id #a"):
        heard("evolved", 1, 0, {"a": [2, walker, walker]}, {}, {})


@pytest.mark.parametrize(
    "name", ["", ".", "..", "../keys", "a/b", "/etc/x", "~", "a\0b", "a" * 65, "a b", "*", "ä"]
)
def test_a_name_that_would_lead_elsewhere_is_none(name):
    with pytest.raises(MisuseError):
        checked_name(name, "a member")
