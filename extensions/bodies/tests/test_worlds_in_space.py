"""The worlds in space have one string in all layouts, with kills, and when they continue."""

import platform
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("rapier3d", reason="needs the extra space")

from minerva_bodies.swarm.flight import Quad
from minerva_bus import run
from minerva_bus.launch.installed import find_world

COLLECTED = {
    "arm": {"z": "max(AParcel.z)", "y": "max(AParcel.y)"},
    "swarm": {"x": Quad.x.every(5), "y": Quad.y.every(5)},
}
GOLDEN = {
    "arm": ({"boxes": 1, "frames": 400}, "0492f16369e878f73df87bb7fa7165e1"),
    "rubble": ({"pieces": 40, "frames": 60}, "edebb05c0a91c9e79c6a84e33f382102"),
    "rover": (
        {"start": "5.2, 5.9, 0", "beams": 45, "frames": 60},
        "1658b16713b53ee422d634017cd94e2d",
    ),
    "swarm": (
        {"quads": 4, "far": 5.0, "hold": 240, "frames": 470},
        "8a58ee30f98559e0fc033f5abce47873",
    ),
}


@pytest.mark.skipif(platform.machine() != "x86_64", reason="the library's bits differ elsewhere")
@pytest.mark.parametrize("world", GOLDEN)
def test_worlds_have_their_golden_digests(world):
    if world == "swarm":
        pytest.importorskip("scipy", reason="needs the extra neighbours")
    options, digest = GOLDEN[world]
    done = run(world, **options, collect=COLLECTED.get(world))
    if world == "arm":  # It has put the box on its pallet.
        columns = done.table().to_dict()
        assert 0.15 < columns["z"][-1] < 0.25
        assert 0.4 < columns["y"][-1] < 0.8
    if world == "swarm":  # It has flown from one side of the tower to the other, around it.
        rows = done.table("AQuad").to_dict()
        assert 2.5 < np.hypot(rows["x"], rows["y"]).min() < 4.0
        assert min(rows["x"][-4:]) > 2.0
    assert done.digest == digest


def test_pieces_fall_and_the_yard_holds_them():
    done = run(
        "rubble", pieces=40, frames=200, collect={"z": "mean(ABrick.z)", "x": "max(ABrick.x)"}
    )
    columns = done.table().to_dict()
    assert columns["z"][0] >= 1.0
    assert 0.0 < columns["z"][-1] < 0.5
    assert columns["x"][-1] < 8.0


@pytest.mark.parametrize(
    ("world", "changes"),
    [
        ("arm", {"boxes = 6": "boxes = 1", "substeps": "renew = 8\nsubsteps"}),
        ("rubble", {"600": "40", "gravity =": "renew = 8\ngravity ="}),
        ("swarm", {"= 200": "= 6", "hold = 750": "hold = 10", "renew = 50": "renew = 8"}),
        ("rover", {'start = ""': 'start = "5.2, 5.9, 0"', "beams =": "renew = 8\nbeams ="}),
    ],
)
def test_layouts_and_kills_and_resumes_have_one_string(world, changes, tmp_path):
    if world == "swarm":
        pytest.importorskip("scipy", reason="needs the extra neighbours")
    pytest.importorskip("mcap")
    layouts = pytest.importorskip("minerva_determinism.layouts")
    text = find_world(world).read_text(encoding="utf-8")
    for old, new in changes.items():
        text = new.join(text.rsplit(old, 1))
    path = tmp_path / f"{world}.toml"
    path.write_text(text)
    records = {}
    for name, layout in {
        "alone": layouts.ALONE,
        "killed": replace(layouts.APART, name="killed", kills=6),
        "resumed": layouts.Layout("resumed", 2, begin=13, past=str(tmp_path / "alone.mcap")),
    }.items():
        records[name] = tmp_path / f"{name}.mcap"
        done = layouts.run_in_layout(path, 30, layout, records[name])
        assert done.returncode == 0, done.stderr
        assert layouts.first_difference(records["alone"], records[name], ("alone", name)).same
