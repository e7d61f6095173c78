"""Files for Rerun made of records, read with Rerun's own reader."""

from importlib.util import find_spec
from types import SimpleNamespace

import numpy as np
import pytest

from minerva_exporters import export_dataset

if not find_spec("rerun"):
    pytest.skip("pip install 'minerva-bus[rerun]'", allow_module_level=True)


@pytest.fixture(scope="module")
def rows(recorded, tmp_path_factory):
    """For each entity: its frames, and the values of its components in order."""
    from rerun.chunk import RrdReader  # late: it starts threads, which a fork would not have

    path = tmp_path_factory.mktemp("rerun") / "yard.rrd"
    export_dataset(recorded[1], path, "rerun")
    made = {}
    for chunk in RrdReader(str(path)).stream().to_chunks():
        if chunk.is_static:
            continue
        entity = made.setdefault(chunk.entity_path, SimpleNamespace(frames=[], values={}))
        batch = chunk.to_record_batch()
        entity.frames += batch.column("frame").to_pylist()
        for name in batch.schema.names:
            if ":" in name:
                values = [row for row in batch.column(name).to_pylist() if row is not None]
                entity.values.setdefault(name.split(":")[1], []).extend(values)
    return made


def test_agents_are_points_with_their_ids(rows, recorded):
    rovers = rows["/world/ARover"]
    assert rovers.frames == [0, 1, 2, 3, 4, 5]
    assert rovers.values["labels"][0] == ["r1", "r2"]
    state = next(node.state for node in recorded[0].scene if node.id == "r1")
    assert rovers.values["positions"][-1][0] == pytest.approx([state["x"], state["y"], 0.0])
    assert rows["/agents/ARover"].values["scalars"] == [[2.0]] * 6


def test_scans_are_points_where_beams_hit(rows):
    scans = rows["/world/r1/scan"]
    assert scans.frames == [1, 2, 3, 4]
    # Of four beams one hits nothing, and one measured nothing.
    near, far = scans.values["positions"][0]
    turn = np.radians(90.0 - 30.0)
    assert near == pytest.approx([0.1 + 2.5 * np.cos(turn), 2.5 * np.sin(turn), 0.0])
    assert far[1] == pytest.approx(0.75 * np.sin(np.radians(120.0)))


def test_scans_lie_where_they_were_measured(rows, recorded):
    places = rows["/world/ARover"].values["positions"]
    # None in frame 5, the last string, because no scan follows it.
    assert [at[0] for at in rows["/world/r1/scan"].values["translation"]] == [
        pytest.approx(at[0]) for at in places[1:5]
    ]


def test_images_readings_and_events_are_there(rows):
    assert rows["/r1/image"].frames == rows["/r1/photo"].frames == [1, 2, 3, 4]
    assert bytes(rows["/r1/photo"].values["blob"][0][0]).startswith(b"\x89PNG")
    assert rows["/r1/odometry/speed"].values["scalars"][0] == [0.5]
    assert rows["/r1/battery/charge"].values["scalars"][0] == [0.5]
    assert rows["/r1/position"].values["positions"][0] == [[50.0, 14.5]]
    assert rows["/events/eSteer"].frames == [0, 1, 3, 4]
    assert rows["/events/eSteer"].values["scalars"][0] == [2.0]


def test_another_name_of_the_file_keeps_its_content(tmp_path):
    from minerva_services.views.rerun.rrd_file import open_stream

    record, other = tmp_path / "yard.mcap", tmp_path / "other.rrd"
    record.write_bytes(b"recorded")
    linked, named = tmp_path / "linked.rrd", tmp_path / "named.rrd"
    linked.symlink_to(other)
    named.hardlink_to(record)
    for path in (linked, named):
        open_stream("yard", path, "").disconnect()
        assert path.read_bytes()[:4] == b"RRF2"
    assert record.read_bytes() == b"recorded"
    assert linked.readlink() == other
