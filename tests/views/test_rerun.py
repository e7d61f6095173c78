"""Recordings for Rerun, read back with Rerun's own reader."""

import importlib.util
import resource
from contextlib import contextmanager
from types import SimpleNamespace

import numpy as np
import pytest
from web_world import FLOOR, PFloor, PMemory, PStone, PWanted, PWay, cart, named, slot, yard

from minerva_bus import MinervaError, View
from minerva_bus.grammar.scene import EMPTY
from minerva_services.views.rerun import RerunView

if not importlib.util.find_spec("rerun"):
    pytest.skip("needs rerun-sdk (pip install 'minerva-bus[rerun]')", allow_module_level=True)

WORLD = PFloor(FLOOR) + PStone(0.5) + named("hall", 3.0, 2.0) + slot("ACart", "c")
LEGS = [(1.0, 0.0, 0.0), (1.5, 0.25, 90.0), (2.0, 0.5, 90.0)]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Three frames: a cart moves and forgets its plan, and a memory fades in frame 2."""
    path = tmp_path_factory.mktemp("rerun") / "new" / "yard.rrd"
    device = RerunView(str(path))
    device.joined(yard())
    memory = PMemory(FLOOR)
    plan = PWay((0.0, 1.0, 2.0), (0.0, 0.0, 1.0)) + PWanted("hall")
    views = [memory + plan, memory, EMPTY]
    for frame, (leg, more) in enumerate(zip(LEGS, views, strict=True)):
        device.show(View(frame, "ePicture", WORLD, {"c": cart(*leg) + more}))
    device.close()
    return path


@pytest.fixture(scope="module")
def rows(recorded):
    """For each entity: its frames, times, and values of components, in order."""
    from rerun.chunk import RrdReader  # late: it starts threads, which a fork would not have

    made = {}
    for chunk in RrdReader(str(recorded)).stream().to_chunks():
        if chunk.is_static:
            continue
        entity = made.setdefault(chunk.entity_path, SimpleNamespace(frames=[], times=[], values={}))
        batch = chunk.to_record_batch()
        entity.frames += batch.column("frame").to_pylist()
        entity.times += [time.total_seconds() for time in batch.column("time").to_pylist()]
        for name in batch.schema.names:
            if ":" in name:
                entity.values.setdefault(name.split(":")[1], []).extend(
                    row for row in batch.column(name).to_pylist() if row is not None
                )
    return made


def test_discs_are_cylinders_that_follow_the_views(rows):
    movers = rows["/world/movers"]
    assert movers.frames == [0, 1, 2]
    assert movers.times == [0.0, 0.1, 0.2]
    assert movers.values["radii"][0] == pytest.approx([0.5, 0.2])
    for centers, (x, y, _) in zip(movers.values["centers"], LEGS, strict=True):
        assert centers[0][:2] == [0.0, 0.0]
        assert centers[1][:2] == pytest.approx([x, y])
    half = np.sqrt(0.5)
    assert movers.values["quaternions"][1][1] == pytest.approx([0.0, 0.0, half, half])
    assert movers.values["labels"][0] == ["", "c"]


def test_headings_point_where_the_cart_looks(rows):
    ((start, end),) = rows["/world/headings"].values["strips"][1]
    assert np.subtract(end, start) == pytest.approx([0.0, 0.16, 0.0], abs=1e-6)


def test_labels_have_their_text_and_the_colour_of_their_mark(rows):
    labels = rows["/world/labels"]
    assert labels.values["labels"][0] == ["hall"]
    marked, plain, _ = (colors[0] for colors in labels.values["colors"])
    assert marked == 0xFF00FFFF != plain


def test_what_is_gone_is_cleared_once(rows):
    assert sorted(rows["/world/lines"].frames) == [0, 1]
    assert len(rows["/world/lines"].values["is_recursive"]) == 1
    assert sorted(rows["/world/knowledge/c/1"].frames) == [0, 2]


def test_a_matrix_is_written_when_it_changes(rows):
    walls = rows["/world/floor/1/1/walls"]
    assert walls.frames == [0]
    corners = np.array(walls.values["vertex_positions"][0])
    # Three cells of half a metre in the third row; walls are one metre high.
    assert corners.min(axis=0) == pytest.approx([1.0, 0.5, 0.004], abs=1e-3)
    assert corners.max(axis=0) == pytest.approx([1.5, 2.0, 1.004], abs=1e-3)


def test_a_later_run_overwrites_its_own_file_only(recorded, tmp_path):
    RerunView(str(recorded))
    foreign = tmp_path / "foreign.rrd"
    foreign.write_bytes(b"RRF2 of someone else")
    with pytest.raises(MinervaError, match="was not written by Minerva Bus"):
        RerunView(str(foreign))


@contextmanager
def room_for(size):
    """Let files of this process have so many bytes, as on a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize("size", [8_000, 20_000])
def test_a_recording_that_could_not_be_written_to_its_end_is_an_error(tmp_path, size):
    device = RerunView(str(tmp_path / "yard.rrd"))
    with room_for(size):
        device.joined(yard())
        for frame in range(300):
            device.show(View(frame, "ePicture", WORLD, {"c": cart(frame / 100, 0.0, 0.0)}))
        with pytest.raises(MinervaError, match=r"rerun: cannot write .*yard\.rrd: .* disk full\?"):
            device.close()


def test_a_link_stays_and_names_the_recording(recorded, tmp_path):
    link = tmp_path / "link.rrd"
    link.symlink_to(tmp_path / "target.rrd")
    device = RerunView(str(link))
    device.joined(yard())
    device.show(View(0, "ePicture", WORLD, {"c": EMPTY}))
    device.close()
    assert link.is_symlink()
    assert (tmp_path / "target.rrd").read_bytes().startswith(recorded.read_bytes()[:4])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"every": 0}, "every is 0; expected a number of frames from 1"),
        ({"path": "a.png"}, r"expected a name that ends in \.rrd"),
        ({"draws": ""}, "expected visual event types"),
    ],
)
def test_options_that_make_no_sense_are_rejected(options, words):
    with pytest.raises(MinervaError, match=words):
        RerunView(**options)


def test_a_missing_library_names_the_extra(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(MinervaError, match=r"rerun needs rerun-sdk: .*minerva-bus\[rerun\]"):
        RerunView()
