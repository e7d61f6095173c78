"""Other tools see poses, maps and sensor data in records."""

import base64
import io
import json
from pathlib import Path

import numpy as np
import pytest

from minerva_analysis.places import SHOWN
from minerva_bus.frame.messages import Readings
from minerva_bus.log.record import Record
from minerva_bus.log.record_writer import RecordWriter
from minerva_exporters import foxglove_channels
from minerva_exporters.foxglove_channels import SCHEMAS, SHOWN_EVERY, shown_readings
from tests.log.recorded_runs import bytes_of, description, fits, happened, others, strings_of
from tests.log.test_sensing import ALL
from tests.runtime.running import here


@pytest.mark.parametrize("schema", ALL)
def test_a_reading_is_shown(schema):
    readings = Readings("physics", "topic", 7, (ALL[schema],))
    shown = [(name, json.loads(data)) for name, data in shown_readings(readings, 1_500_000_000)]
    if "." not in schema:
        assert shown == []
        return
    [(name, plain)] = shown
    assert name == schema.strip()
    assert plain.keys() == SCHEMAS[name]["properties"].keys()
    assert plain["timestamp"] == {"sec": 1, "nsec": 500_000_000}


def test_angles_and_pixels_are_shown_where_they_are():
    [(_, scan)] = shown_readings(Readings("m", "t", 0, (ALL["foxglove.LaserScan"],)), 0)
    assert json.loads(scan)["end_angle"] == pytest.approx(np.radians(30.0))
    assert json.loads(scan)["ranges"] == [1.5, 0.0, pytest.approx(0.1), 0.0, -1.0]
    [(_, image)] = shown_readings(Readings("m", "t", 0, (ALL["foxglove.RawImage"],)), 0)
    assert base64.b64decode(json.loads(image)["data"]) == bytes(range(18))
    assert json.loads(image)["step"] == 9


def test_a_robots_scans_are_shown_where_it_is(tmp_path):
    path = tmp_path / "run.mcap"
    done = here(tmp_path, "run", "robot", "--in-process", "--frames", 12, "--until", "",
                "--record", path, "--record-topics", "scan")  # fmt: skip
    assert done.returncode == 0, done.stderr
    shown = others(path.read_bytes())
    scans = shown["topics/scan/physics/LaserScan"]
    with Record(path) as record:
        assert len(scans) == sum(len(readings.readings) for _, readings in record.sensed())
    fits(scans[0][2], json.loads(scans[0][0].data))
    _, _, last = shown["transforms"][-1]
    assert scans[0][2]["frame_id"] == last["child_frame_id"]


def test_others_see_where_agents_are():
    channels = others(bytes_of("meadow"))
    _, _, shown = channels["poses/AFox"][0]
    assert shown["poses"][1]["position"] == {"x": 22, "y": 13, "z": 0}
    assert shown["poses"][1]["orientation"] == {"x": 0, "y": 0, "z": 1, "w": 0}
    (_, _, shown), *_ = others(bytes_of("robot"))["poses/ARobot"]
    state = next(node.state for node in strings_of("robot")[0] if node.symbol == "ARobot")
    place = shown["poses"][0]["position"]
    assert place["x"] == pytest.approx(state["x0"] + state["row"] * state["cell"], abs=1e-4)


def test_others_see_the_map():
    [(_, _, shown)] = others(bytes_of("robot"))["map"]
    floor = next(node for node in strings_of("robot")[0] if node.symbol == "PMap").parameters
    rows, columns = floor["cells"].shape
    data = base64.b64decode(shown["data"])
    assert shown["column_count"] == rows
    assert len(data) == shown["row_stride"] * columns == 4 * rows * columns
    red = np.frombuffer(data, np.uint8).reshape(columns, rows, 4)[:, :, 0]
    reds = {100: 0x9A, 0: 0xFB, -1: 0xE6}  # y runs along the rows of a grid, x along each row
    assert (np.vectorize(reds.__getitem__)(floor["cells"]) == red.T).all()


def test_a_world_of_many_shows_some_of_them(monkeypatch):
    monkeypatch.setattr(foxglove_channels, "SHOWN", 10)
    file, frames = happened("flock")
    stream = io.BytesIO()
    writer = RecordWriter(stream, description(file))
    writer.frame(*frames[0], 0.0, {})
    writer.frame(*frames[1], 0.0, {})
    writer.finish()
    shown = [len(poses["poses"]) for _, _, poses in others(stream.getvalue())["poses/ABird"]]
    assert shown
    assert all(8 <= count <= 20 for count in shown)


def test_the_document_has_the_interval():
    document = (Path(__file__).parents[3] / "docs" / "records.md").read_text(encoding="utf-8")
    assert f"every {SHOWN_EVERY} s of world time" in document
    assert f"about {SHOWN}." in document
